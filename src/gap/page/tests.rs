use super::*;
use crate::{
    gap::findings::{Class, SCHEMA_VERSION},
    twin::{Machine, Twin},
};

pub(in crate::gap) fn found(says: &str) -> Found<'static> {
    let document = Document {
        schema_version: SCHEMA_VERSION,
        verdict: Verdict::Ambiguous,
        says: says.to_owned(),
        places: Vec::new(),
        effects: vec![NamedEffect {
            numbers_when_added: Vec::new(),
            name: "drive.delay".to_owned(),
            axis: crate::effects::Axis::Motors,
            parameters: Vec::new(),
            p_value: 1e-9,
            gap_before: None,
            gap_after: None,
            gap_signal: None,
            held_out_gain: 0.5,
            why: "v < 1 & \"late\"".to_owned(),
        }],
        class: vec![Class {
            names: vec!["a".to_owned(), "b".to_owned()],
            experiment: "x".to_owned(),
        }],
        rejected: Vec::new(),
        gap: Vec::new(),
        refit: Vec::new(),
        next_experiment: Some("klasktron collect <next>".to_owned()),
        doubts: vec!["<doubt>".to_owned(), says.to_owned()],
    };
    let twin = Twin::nominal(Machine::Table);
    Found { document, twin, outcomes: Vec::new(), floors: Vec::new() }
}

fn html(says: &str) -> String {
    let provenance = Provenance::new("klasktron gap <a&b>".to_owned());
    page(&found(says), "Gap of <x>", &provenance, &[])
}

#[test]
fn nothing_that_was_found_becomes_markup() {
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
