//! The documents name tests that exist, and quote code that exists.

use std::fs;
use std::path::{Path, PathBuf};

fn sources(folder: &Path, all: &mut Vec<PathBuf>) {
    let entries = fs::read_dir(folder).expect("a folder of this project");
    for path in entries.map(|entry| entry.expect("readable").path()) {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            sources(&path, all);
        } else if name.ends_with(".rs") {
            all.push(path);
        }
    }
}

/// What stands between backticks.
fn spans(cell: &str) -> impl Iterator<Item = &str> {
    cell.split('`').skip(1).step_by(2)
}

/// The last cells of all rows of tables whose last column has tests.
fn tests_named(document: &str) -> Vec<&str> {
    let mut in_table = false;
    let mut cells = Vec::new();
    for line in document.lines() {
        if !line.starts_with('|') {
            in_table = false;
            continue;
        }
        let cell = line.trim().trim_matches('|').rsplit('|').next().unwrap_or_default().trim();
        if cell.starts_with("test") {
            in_table = true;
        } else if in_table {
            cells.push(cell);
        }
    }
    cells
}

#[test]
fn every_test_named_in_the_documents_exists() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let code: String = files.iter().map(|file| fs::read_to_string(file).expect("text")).collect();
    let mut named = 0;
    for document in ["PAPER.md", "HARD_CASES.md"] {
        let text = fs::read_to_string(root.join("docs").join(document)).expect("a document");
        for span in tests_named(&text).into_iter().flat_map(spans) {
            let name = span.rsplit("::").next().unwrap_or_default();
            let (name, is_whole) = match name.strip_suffix('*') {
                Some(start) => (start, false),
                None => (name, true),
            };
            let is_name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
            if !name.contains('_') || !name.chars().all(is_name) {
                continue;
            }
            let function = format!("fn {name}{}", if is_whole { "(" } else { "" });
            assert!(code.contains(&function), "{document} names the test `{span}`, which does not exist");
            named += 1;
        }
    }
    assert!(named > 60, "{named}");
}

/// Words, so that indentation does not matter.
fn words(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn quotations_stand_in_the_files_they_are_from() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    let text = fs::read_to_string(docs.join("EXTENDING.md")).expect("a document");
    let mut parts = text.split("```");
    let (mut quoted, mut before) = (0, parts.next().unwrap_or_default());
    while let (Some(code), Some(after)) = (parts.next(), parts.next()) {
        let link = before
            .rsplit("](")
            .next()
            .and_then(|rest| rest.split_once(')'))
            .expect("a link before the code")
            .0;
        let file = fs::read_to_string(docs.join(link)).unwrap_or_else(|error| panic!("{link}: {error}"));
        let code = words(code.strip_prefix("rust").expect("a language"));
        assert!(words(&file).contains(&code), "{link} has no {code}");
        (quoted, before) = (quoted + 1, after);
    }
    assert!(quoted >= 8, "{quoted} quotations");
}
