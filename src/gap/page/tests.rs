use super::*;
use crate::{
    gap::findings::{Evidence, Indistinguishable, NextExperiment, SCHEMA_VERSION},
    twin::{Machine, Twin},
};

pub(in crate::gap) fn found(summary: &str) -> Found<'static> {
    let document = Document {
        schema_version: SCHEMA_VERSION,
        verdict: Verdict::Ambiguous,
        summary: summary.to_owned(),
        localization: Vec::new(),
        effects: vec![IdentifiedEffect {
            estimates_after_step: Vec::new(),
            name: "drive.delay".to_owned(),
            location: crate::effects::Axis::Motors,
            parameters: Vec::new(),
            evidence: Evidence {
                log_score_gain: None,
                standard_error: None,
                p_value: 1e-9,
                data: "training sessions, 80 blocks of 0.5 s".to_owned(),
                comparisons: 7,
            },
            rmse_before: None,
            rmse_after: None,
            signal: None,
            unit: None,
            validation_gain: Some(0.5),
            explanation: "v < 1 & \"late\"".to_owned(),
        }],
        indistinguishable: vec![Indistinguishable {
            names: vec!["a".to_owned(), "b".to_owned()],
            experiment: "x".to_owned(),
        }],
        rejected: Vec::new(),
        residuals: Vec::new(),
        parameter_changes: Vec::new(),
        description: None,
        next_experiment: Some(NextExperiment {
            command: Some("klasktron collect <next>".to_owned()),
            motion: "steps".to_owned(),
            decides: "which of a and b".to_owned(),
        }),
        warnings: vec!["<doubt>".to_owned(), summary.to_owned()],
        journal: Vec::new(),
    };
    let twin = Twin::nominal(Machine::Table);
    Found { document, twin, outcomes: Vec::new(), floors: Vec::new() }
}

fn html(says: &str) -> String {
    let provenance = Provenance::new("klasktron gap <a&b>".to_owned());
    page(&found(says), "Gap of <x>", &provenance, &[])
}

#[test]
fn findings_are_escaped_as_text() {
    let html = html("<script>1</script>");
    for text in ["<script>", "<x>", "<a&b>", "<next>", "<doubt>", "v < 1"] {
        assert!(!html.contains(text), "{text}");
    }
    assert!(html.contains("&lt;script&gt;1&lt;/script&gt;"));
    assert!(html.contains("v &lt; 1 &amp; &quot;late&quot;"));
    assert_eq!(html.matches("class=\"warning\"").count(), 1);
}

#[test]
fn the_same_findings_make_the_same_page() {
    assert_eq!(html("one"), html("one"));
}

#[test]
fn the_verdict_is_a_badge() {
    let html = html("one");
    assert!(html.contains("<span class=\"badge warn\">ambiguous</span>"));
    assert!(html.contains("<h2>Missing effects</h2>") && html.contains("Next experiment: Steps."));
    // The page has no section for content that the document lacks.
    for section in ["Residuals", "Parameter changes", "Rejected candidates"] {
        assert!(!html.contains(&format!("<h2>{section}</h2>")), "{section}");
    }
}
