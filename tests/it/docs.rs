//! README and the pages of `docs/`: a page per subcommand, links with targets, pictures of moderate size, commands that
//! work, and plain language.

use crate::support::{klasktron, said};
use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

/// Largest picture (bytes): 120 kB at one pixel per point, four times that at twice the density.
const LARGEST_PICTURE: u64 = 480_000;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// README and every page.
fn pages() -> Vec<PathBuf> {
    let pages = fs::read_dir(root().join("docs")).unwrap().map(|entry| entry.unwrap().path());
    let mut pages: Vec<PathBuf> =
        pages.filter(|path| path.extension().is_some_and(|extension| extension == "md")).collect();
    pages.push(root().join("README.md"));
    pages.sort();
    pages
}

/// Subcommands as `--help` lists them.
fn subcommands() -> Vec<String> {
    let help = said(&klasktron(&["--help"])).0;
    let lines = help.lines().skip_while(|line| *line != "Data:");
    let lines = lines.take_while(|line| *line != "Options:");
    let named = lines.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names = named.filter_map(|line| line.split_whitespace().next());
    names.filter(|name| *name != "help").map(ToOwned::to_owned).collect()
}

#[test]
fn every_subcommand_has_a_page_with_a_picture_and_is_in_both_lists() {
    let lists = ["README.md", "docs/README.md"];
    let lists = lists.map(|name| fs::read_to_string(root().join(name)).unwrap());
    let names = subcommands();
    assert!(14 <= names.len(), "{names:?}");
    for name in names {
        let page = fs::read_to_string(root().join(format!("docs/{name}.md"))).unwrap_or_default();
        assert!(
            page.starts_with(&format!("# `klasktron {name}`")),
            "docs/{name}.md has no heading"
        );
        assert!(page.contains("](pictures/"), "docs/{name}.md has no picture");
        assert!(page.contains("\n## Limits\n"), "docs/{name}.md does not say its limits");
        for list in &lists {
            assert!(list.contains(&format!("{name}.md)")), "{name} is missing in a list of pages");
        }
    }
}

/// Anchors of the headings of a page, as GitHub and MkDocs make them.
fn anchors(page: &Path) -> BTreeSet<String> {
    let text = fs::read_to_string(page).unwrap();
    let headings = text.lines().filter(|line| line.starts_with('#'));
    let anchor = |heading: &str| -> String {
        let words = heading.trim_start_matches('#').trim().to_lowercase();
        let kept = words.chars().filter(|own| own.is_alphanumeric() || " -_".contains(*own));
        kept.map(|own| if own == ' ' { '-' } else { own }).collect()
    };
    headings.map(anchor).collect()
}

#[test]
fn links_and_pictures_are_there_and_every_picture_is_shown() {
    let mut shown = BTreeSet::new();
    for page in pages() {
        let text = fs::read_to_string(&page).unwrap();
        for link in text.split("](").skip(1).filter_map(|after| after.split(')').next()) {
            if link.starts_with("https://") {
                continue;
            }
            let (file, heading) = link.split_once('#').unwrap_or((link, ""));
            let target = match file {
                "" => page.clone(),
                file => page.parent().unwrap().join(file),
            };
            assert!(target.exists(), "{}: {link} is not there", page.display());
            assert!(
                heading.is_empty() || anchors(&target).contains(heading),
                "{}: {link} has no such heading",
                page.display()
            );
            shown.insert(target.canonicalize().unwrap());
        }
        for report in text.split("`reports/").skip(1) {
            let name = report.split(['`', '/']).next().unwrap();
            assert!(root().join("reports").join(name).is_dir(), "{}: {name}", page.display());
        }
    }
    for entry in fs::read_dir(root().join("docs/pictures")).unwrap() {
        let path = entry.unwrap().path();
        // Beside the pictures lie the hashes of the code that drew them.
        if path.extension().is_some_and(|extension| extension == "json") {
            continue;
        }
        let bytes = fs::metadata(&path).unwrap().len();
        assert!(bytes <= LARGEST_PICTURE, "{}: {bytes} bytes", path.display());
        assert!(shown.contains(&path.canonicalize().unwrap()), "{} is on no page", path.display());
    }
}

/// Lines that a person is told to type, in order, without those of cargo.
fn typed(page: &str) -> impl Iterator<Item = &str> {
    let typed = page.lines().filter_map(|line| line.strip_prefix("$ "));
    typed.filter(|line| !line.starts_with("cargo test") && *line != "klasktron train")
}

/// The line with the program under test for the installed one, and few epochs and steps for many.
fn quick(line: &str) -> String {
    let program = env!("CARGO_BIN_EXE_klasktron");
    line.replace("cargo run --release --", "klasktron")
        .replace("klasktron ", &format!("{program} "))
        .replace("--epochs 300", "--epochs 3")
        .replace("demo --quick", "demo --help")
        .replace("--seconds 60", "--seconds 20")
        .replace("train --steps 20e6", "train --steps 500 --envs 16 --hidden 8 --games 0")
}

#[cfg(unix)]
#[test]
fn every_command_of_the_pages_works() {
    let mut run = BTreeSet::new();
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("tests/data");
    fs::create_dir_all(&data).unwrap();
    for entry in fs::read_dir(root().join("tests/data")).unwrap() {
        let entry = entry.unwrap();
        if entry.file_type().unwrap().is_dir() {
            continue;
        }
        fs::copy(entry.path(), data.join(entry.file_name())).unwrap();
    }
    // What a page tells to type may use what README's commands have written.
    let mut pages = pages();
    pages.sort_by_key(|page| page.parent() != Some(root()));
    for page in pages {
        let text = fs::read_to_string(&page).unwrap();
        for line in typed(&text) {
            // One line on two pages is run once; so is a recording that exists then.
            if !run.insert(line.to_owned()) {
                continue;
            }
            let mut command = Command::new("sh");
            command.args(["-c", &quick(line)]).current_dir(dir.path());
            let status = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
            let status = status.status().unwrap();
            let expected = if line.contains("recover") { 3 } else { 0 };
            assert_eq!(status.code(), Some(expected), "{}: {line}", page.display());
        }
    }
    assert!(15 <= run.len(), "{run:?}");
}

/// The settings of the page are settings that the program takes.
#[test]
fn the_settings_file_of_the_page_is_right() {
    let page = fs::read_to_string(root().join("docs/settings.md")).unwrap();
    let file = page.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("klasktron.toml");
    fs::write(&path, file).unwrap();
    let path = path.to_str().unwrap();
    let (_, stderr, status) = said(&klasktron(&["train", "--print-settings", "--config", path]));
    assert_eq!(status, 0, "{stderr}");
    let wrong = file.replace("epochs", "epoch");
    fs::write(path, wrong).unwrap();
    let (_, stderr, _) = said(&klasktron(&["train", "--config", path]));
    let expected = page.lines().find(|line| line.starts_with("error: klasktron.toml")).unwrap();
    assert!(stderr.trim_end().ends_with(&expected["error: ".len()..]), "{stderr}");
}

/// Every page is in the index, from which the site takes its navigation.
#[test]
fn every_page_is_in_the_index() {
    let index = fs::read_to_string(root().join("docs/README.md")).unwrap();
    for page in pages() {
        let name = page.file_name().unwrap().to_string_lossy().into_owned();
        assert!(name == "README.md" || index.contains(&format!("]({name})")), "{name}");
    }
}

/// Largest number of words in a sentence.
const LONGEST_SENTENCE: usize = 35;

/// First words of a sentence with a noun clause for its subject.
const HEADLESS: [&str; 6] = ["What", "Whether", "How", "Where", "Which", "Who"];

/// Words of no textbook, and the term that replaces each.
const DIALECT: [(&str, &str); 29] = [
    ("parted", "split"),
    ("is told", "is reported"),
    ("are told", "are reported"),
    ("told apart", "distinguished"),
    ("tell apart", "distinguish"),
    ("taken back", "removed"),
    ("beside", "compared with, next to"),
    ("hangs on", "depends on"),
    ("is none", "is absent"),
    ("at once the noise", "at the noise level"),
    ("judges", "evaluates"),
    ("judging", "validation"),
    ("doubts", "warnings"),
    ("doubtful", "a warning"),
    ("mimicry", "bias on reference data"),
    ("scatter", "noise, standard deviation"),
    ("scatters", "noise, standard deviation"),
    ("made up for", "compensated, confounded"),
    ("makes up for", "compensates, is confounded"),
    ("whatever", "the thing itself"),
    ("rails", "axes"),
    ("a play", "backlash"),
    ("once more", "again"),
    ("surer", "overconfident"),
    ("stands for", "is"),
    ("stands on", "is"),
    ("comes near", "approaches"),
    ("missed by the data", "significant"),
    ("in earnest", "to convergence"),
];

/// The sentences of a page with the lines in which their paragraphs begin; without code, tables, headings and pictures.
fn sentences(page: &str) -> Vec<(usize, String)> {
    let mut blocks: Vec<(usize, String)> = Vec::new();
    let (mut is_code, mut is_open) = (false, false);
    for (number, line) in page.lines().enumerate() {
        let line = line.trim();
        let is_fence = line.starts_with("```");
        is_code ^= is_fence;
        if is_code
            || is_fence
            || line.is_empty()
            || line.starts_with(['|', '#', '<'])
            || line.starts_with("![")
        {
            is_open = false;
            continue;
        }
        let is_item = line.starts_with("- ")
            || line.split_once(". ").is_some_and(|(digits, _)| digits.parse::<u32>().is_ok());
        match blocks.last_mut().filter(|_| is_open && !is_item) {
            Some((_, block)) => *block += &format!(" {line}"),
            None => blocks.push((number + 1, line.trim_start_matches("- ").to_owned())),
        }
        is_open = true;
    }
    let of_block = |(number, block): (usize, String)| {
        // Code counts as one word.
        let plain: String = block
            .split('`')
            .enumerate()
            .map(|(k, part)| if k % 2 == 0 { part } else { "x" })
            .collect();
        let ends = plain.replace(". ", ".\n").replace("? ", "?\n").replace("! ", "!\n");
        ends.lines().map(|sentence| (number, sentence.to_owned())).collect::<Vec<_>>()
    };
    blocks.into_iter().flat_map(of_block).collect()
}

/// The faults of one sentence.
fn faults(sentence: &str) -> Vec<String> {
    let is_part = |letter: char| letter.is_alphanumeric();
    let words: Vec<&str> = sentence.split_whitespace().collect();
    let mut faults = Vec::new();
    if LONGEST_SENTENCE < words.len() {
        faults.push(format!("has {} words, allowed are {LONGEST_SENTENCE}", words.len()));
    }
    let first = words
        .iter()
        .map(|word| word.trim_matches(|own| !is_part(own)))
        .find(|word| !word.is_empty());
    if first.is_some_and(|word| HEADLESS.contains(&word)) && !sentence.contains('?') {
        faults.push("begins with a clause: name the thing".to_owned());
    }
    let bare: Vec<String> = sentence
        .split(|letter: char| !is_part(letter) && letter != '-')
        .filter(|word| !word.is_empty())
        .map(str::to_lowercase)
        .collect();
    let bare = format!(" {} ", bare.join(" "));
    let used = DIALECT.iter().filter(|(word, _)| bare.contains(&format!(" {word} ")));
    faults.extend(used.map(|(word, better)| format!("says '{word}': write {better}")));
    faults
}

#[test]
fn the_pages_are_in_plain_words_and_short_sentences() {
    let mut found = Vec::new();
    for page in pages() {
        let text = fs::read_to_string(&page).unwrap();
        for (line, sentence) in sentences(&text) {
            let faults = faults(&sentence);
            found.extend(
                faults
                    .iter()
                    .map(|fault| format!("{}:{line}: {fault}: {sentence}", page.display())),
            );
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn faults_of_language_are_found() {
    let page = "# What a heading may say\n\n- It is told in\n  two lines.\n- Why not?\n\nWhere it fails, it ends. What \
                fails?\n\n```\nWhatever code says\n```\n| Where | tables |\n";
    let found = sentences(page);
    let lines: Vec<usize> = found.iter().map(|(line, _)| *line).collect();
    assert_eq!(lines, [3, 5, 7, 7]);
    let counts: Vec<usize> = found.iter().map(|(_, sentence)| faults(sentence).len()).collect();
    assert_eq!(counts, [1, 0, 1, 0], "{found:?}");
    assert_eq!(faults(&"word ".repeat(LONGEST_SENTENCE + 1)).len(), 1);
    assert!(faults("Scattered values.").is_empty());
    assert!(sentences("The `beside` of it.").iter().all(|(_, own)| faults(own).is_empty()));
}
