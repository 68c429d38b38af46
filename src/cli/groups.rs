//! Groups of subcommands in the help of the whole program.

use clap::{
    Command,
    builder::styling::{Style, Styles},
};

/// Heading of each group with its subcommands, in the order of the help.
pub(super) const GROUPS: [(&str, &[&str]); 5] = [
    ("Data", &["collect", "rig", "info", "recover", "replay", "import", "export"]),
    ("Camera", &["calibrate-camera", "tune-detector", "detect"]),
    ("Identify", &["fit-actuator", "calibrate", "gap", "effects", "simulate", "diff", "tune-ekf"]),
    ("Learn and play", &["train", "play", "eval", "sweep", "demo"]),
    ("Tools", &["schema", "completions", "man"]),
];

/// Columns of a name, with the space on both sides.
const NAME_COLUMNS: usize = 19;

/// Template of the help of the whole program, with the visible subcommands of `root` by group.
pub(super) fn help_template(root: Command) -> String {
    let styles = Styles::styled();
    let groups: Vec<String> = GROUPS
        .iter()
        .map(|(heading, names)| {
            let heading = styled(*styles.get_header(), &format!("{heading}:"));
            let lines = names.iter().filter_map(|name| line(&root, name, *styles.get_literal()));
            std::iter::once(heading).chain(lines).collect::<Vec<_>>().join("\n")
        })
        .collect();
    let options = styled(*styles.get_header(), "Options:");
    format!(
        "{{before-help}}{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{}\n\n{options}\n\
         {{options}}{{after-help}}",
        groups.join("\n\n")
    )
}

/// Name and summary of a subcommand; `None` where `root` does not have it.
fn line(root: &Command, name: &str, style: Style) -> Option<String> {
    let command = root.get_subcommands().find(|command| command.get_name() == name)?;
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let space = " ".repeat(NAME_COLUMNS.saturating_sub(2 + name.len()));
    Some(format!("  {}{space}{about}", styled(style, name)))
}

fn styled(style: Style, text: &str) -> String {
    format!("{style}{text}{style:#}")
}
