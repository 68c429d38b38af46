//! A room may use rooms of lower layers only, or of its own layer in one direction.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

/// Rooms by layer, lowest first; `cli` and `commands` belong to the binary.
const LAYERS: [&[&str]; 4] = [
    &["units", "seed", "stats", "parallel", "lanes", "report", "provenance"],
    &["board", "recording", "nn"],
    &[
        "can", "gantry", "link", "live", "scene", "rig", "camera", "actuator", "effects", "twin",
        "ekf", "game", "opponent", "ppo",
    ],
    &["import", "collect", "gap", "referee", "train", "play", "demo", "sweep"],
];

fn layer_of(room: &str) -> usize {
    LAYERS
        .iter()
        .position(|rooms| rooms.contains(&room))
        .unwrap_or_else(|| panic!("room '{room}' is in no layer: add it to LAYERS"))
}

/// Rooms that `text` imports from the crate root, up to its first test module.
fn imports(text: &str) -> BTreeSet<String> {
    let code = text.split("#[cfg(test)]").next().unwrap();
    let code: String = code
        .lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .collect::<Vec<_>>()
        .join("\n");
    let mut rooms = BTreeSet::new();
    for after in code.split("crate::").skip(1) {
        if let Some(group) = after.strip_prefix('{') {
            let mut depth = 0;
            let mut word = String::new();
            for character in group.chars() {
                match character {
                    '{' => depth += 1,
                    '}' if depth == 0 => break,
                    '}' => depth -= 1,
                    ',' | ':' if depth == 0 => {
                        rooms.insert(std::mem::take(&mut word));
                        continue;
                    }
                    _ => {}
                }
                if depth == 0 && (character.is_alphanumeric() || character == '_') {
                    word.push(character);
                }
            }
            rooms.insert(word);
        } else {
            let end = after.find(|c: char| !c.is_alphanumeric() && c != '_');
            rooms.insert(after[..end.unwrap_or(after.len())].to_owned());
        }
    }
    rooms.retain(|room| LAYERS.iter().any(|rooms| rooms.contains(&room.as_str())));
    rooms
}

fn visit(path: &Path, room: &str, edges: &mut BTreeMap<(String, String), String>) {
    if path.is_dir() {
        for entry in fs::read_dir(path).unwrap() {
            visit(&entry.unwrap().path(), room, edges);
        }
    } else if path.extension().is_some_and(|extension| extension == "rs") {
        for used in imports(&fs::read_to_string(path).unwrap()) {
            if used != room {
                edges.insert((room.to_owned(), used), path.display().to_string());
            }
        }
    }
}

fn edges() -> BTreeMap<(String, String), String> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut edges = BTreeMap::new();
    for entry in fs::read_dir(&src).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        // The binary, and the Python module, which is a crate of its own.
        if !["lib", "main", "cli", "commands", "python"].contains(&name.as_str()) {
            layer_of(&name);
            visit(&path, &name, &mut edges);
        }
    }
    edges
}

#[test]
fn no_room_uses_a_room_above_it() {
    for ((room, used), file) in edges() {
        assert!(
            layer_of(&used) <= layer_of(&room),
            "{file}: room '{room}' (layer {}) uses '{used}' (layer {})",
            layer_of(&room),
            layer_of(&used)
        );
    }
}

#[test]
fn rooms_of_one_layer_use_each_other_in_one_direction() {
    let edges = edges();
    for (room, used) in edges.keys() {
        assert!(
            !edges.contains_key(&(used.clone(), room.clone())),
            "rooms '{room}' and '{used}' use each other"
        );
    }
}

/// What is fitted to recordings of the virtual rig must not share a line of dynamics with it, else a
/// fit would only recover its own code. So the rig may not use `gantry`, `actuator`, or any room of
/// effects, twins and simulators: only words, bytes and geometry.
#[test]
fn the_virtual_rig_has_its_own_physics() {
    let allowed = ["units", "seed", "can", "link", "board", "recording"];
    for ((room, used), file) in edges() {
        assert!(
            room != "rig" || allowed.contains(&used.as_str()),
            "{file}: the virtual rig uses '{used}'"
        );
    }
}

#[test]
fn imports_are_read_as_they_are_written() {
    let text = "use crate::{\n    recording::{Recording, topic},\n    stats::mean,\n};\nuse crate::nn;\n\
                fn f() { crate::units::g() }\n// crate::report in a comment\n#[cfg(test)]\nuse crate::can;";
    let found: Vec<String> = imports(text).into_iter().collect();
    assert_eq!(found, ["nn", "recording", "stats", "units"]);
}
