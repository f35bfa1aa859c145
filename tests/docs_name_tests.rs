//! The documents name tests that exist, and quote code that exists.

use std::collections::BTreeSet;
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

/// Adds the names of functions that run as tests: those with the attribute, and those of
/// `proptest!`.
fn tests(code: &str, all: &mut BTreeSet<String>) {
    let (mut is_marked, mut block) = (false, None);
    for line in code.lines() {
        let text = line.trim_start();
        let indent = line.len() - text.len();
        if let Some((name, _)) = text.strip_prefix("fn ").and_then(|rest| rest.split_once('(')) {
            if is_marked || block.is_some_and(|block| indent == block + 4) {
                all.insert(name.to_owned());
            }
            is_marked = false;
        }
        match text {
            "#[test]" => is_marked = true,
            "proptest! {" => block = Some(indent),
            "}" if block == Some(indent) => block = None,
            _ => {}
        }
    }
}

/// What stands between backticks.
fn spans(line: &str) -> impl Iterator<Item = &str> {
    line.split('`').skip(1).step_by(2)
}

/// A name without the module that it is in.
fn last(span: &str) -> &str {
    span.rsplit("::").next().unwrap_or(span)
}

/// What a document names as tests: names in tables, in a last column that has tests, and anywhere
/// names of four words and more.
fn tests_named(document: &str) -> Vec<&str> {
    let mut in_table = false;
    let mut named = Vec::new();
    for line in document.lines() {
        named.extend(spans(line).filter(|span| last(span).matches('_').count() >= 3));
        let row = line.trim_end().strip_prefix('|').map(|row| row.trim_end_matches('|'));
        let cell = row.and_then(|row| row.rsplit('|').next()).map(str::trim);
        match cell {
            Some(cell) if in_table => {
                named.extend(spans(cell).filter(|span| span.contains("::") || last(span).contains('_')));
            }
            cell => in_table = cell.is_some_and(|cell| cell.starts_with("test")),
        }
    }
    let is_name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "_*".contains(c);
    named.retain(|span| last(span).chars().all(is_name));
    named
}

#[test]
fn every_test_named_in_the_documents_exists() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let mut all = BTreeSet::new();
    files.iter().for_each(|file| tests(&fs::read_to_string(file).expect("text"), &mut all));
    let mut named = 0;
    for document in fs::read_dir(root.join("docs")).expect("documents") {
        let path = document.expect("readable").path();
        if path.extension().is_none_or(|extension| extension != "md") {
            continue;
        }
        for span in tests_named(&fs::read_to_string(&path).expect("a document")) {
            let name = last(span);
            let is_there = match name.strip_suffix('*') {
                Some(start) => all.iter().any(|test| test.starts_with(start)),
                None => all.contains(name),
            };
            assert!(is_there, "{} names the test `{span}`, which does not exist", path.display());
            named += 1;
        }
    }
    assert!(named > 300, "{named}");
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
