//! What the contract's page says must hold. README and the other pages: `docs`.

use klasktron::recording::topic::schema_of;
use std::{fs, path::Path};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn the_contracts_table_names_the_schema_of_every_topic() {
    let page = fs::read_to_string(root().join("datasets_schema/README.md")).unwrap();
    let mut checked = 0;
    for line in page.lines().filter(|line| line.starts_with("| `/")) {
        let cells: Vec<&str> = line.split(" | ").collect();
        let schema = cells[1].trim_matches('`');
        for topic in cells[0].trim_start_matches("| ").split(", ") {
            let topic = topic.trim_matches('`').replace("{left,right}", "left");
            let topic = topic.replace("{a,b}", "a").replace("{name}", "slide");
            if topic.starts_with("/truth") {
                continue;
            }
            assert_eq!(schema_of(&topic), Some(format!("klasktron.{schema}").as_str()), "{topic}");
            checked += 1;
        }
    }
    assert!(11 <= checked, "{checked}");
}
