//! What a run leaves behind, used again: gone on with, drawn again, compared, and opened in a browser.

mod program;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use program::{folder, refused, str, succeeds};
use serde_json::Value;

/// Two scenes, few frames.
fn run<'a>(sheet: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut all = vec!["reproduce", "--preset", "quick", "--scene", sheet, "--scene", sheet, "--frames", "6"];
    all.extend(["--size", "40", "--threads", "2", "--out", out]);
    all.extend(more);
    all
}

fn summary(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("summary.json")).expect("a summary")).expect("JSON")
}

/// Columns of a row that do not depend on the machine's mood.
fn fixed(row: &str) -> Vec<&str> {
    let columns: Vec<_> = row.split(',').collect();
    [&columns[..5], &columns[9..12], &columns[13..18], &columns[27..34]].concat()
}

#[test]
fn results_are_gone_on_with_drawn_again_compared_and_opened() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("results");
    let [sheet, path] = [str(&sheet), str(&out)];
    succeeds(&run(sheet, path, &[]));
    let whole = fs::read_to_string(out.join("frames.csv")).expect("rows");
    let before = summary(&out);
    let verdicts = |summary: &Value| -> Vec<Value> {
        summary["claims"].as_array().expect("claims").iter().map(|c| c["verdict"].clone()).collect()
    };

    // Drawn again elsewhere: the same claims, figures and pictures, and the same page but for rounding.
    let redrawn = temporary.path().join("redrawn");
    succeeds(&["reproduce", "--from", path, "--out", str(&redrawn)]);
    let after = summary(&redrawn);
    assert_eq!(verdicts(&after), verdicts(&before));
    assert_eq!(after["scenes"][1]["images"], before["scenes"][1]["images"]);
    let length = |folder: &Path| fs::read(folder.join("report.html")).expect("a report").len();
    assert!(length(&redrawn).abs_diff(length(&out)) < 2000);
    let figures = |folder: &Path| fs::read_dir(folder.join("figures")).expect("figures").count();
    assert_eq!(figures(&redrawn), figures(&out));

    // Laid over itself nothing is worse; with an update that took twice as long, that is.
    let printed = succeeds(&["reproduce", "--from", str(&redrawn), "--baseline", path]);
    assert!(printed.contains(" 0 worse and 0 better"), "{printed}");
    let slower = |line: &str| {
        let mut columns: Vec<_> = line.split(',').map(str::to_owned).collect();
        if columns[1] == "refit" {
            columns[6] = (5.0 * columns[6].parse::<f64>().expect("a time")).to_string();
        }
        columns.join(",") + "\n"
    };
    let mut rows = whole.lines();
    let header = rows.next().expect("a header").to_owned() + "\n";
    fs::write(redrawn.join("frames.csv"), header + &rows.map(slower).collect::<String>()).expect("written");
    let printed = succeeds(&["reproduce", "--from", str(&redrawn), "--baseline", path]);
    assert!(printed.contains("regression          sheet/, refit, update"), "{printed}");
    assert!(summary(&redrawn)["baseline"]["changes"].as_array().is_some_and(|c| !c.is_empty()));

    in_a_browser(&out.join("report.html"), temporary.path());

    // Killed in the second scene, in the middle of a row, and gone on with.
    let rows = whole.lines().filter(|line| line.starts_with("sheet/,")).count();
    let kept: Vec<_> = whole.lines().take(1 + rows + 40).collect();
    fs::write(out.join("frames.csv"), format!("{}\nsheet/-2,ref", kept.join("\n"))).expect("written");
    let mut killed = before.clone();
    killed["scenes"].as_array_mut().expect("scenes").truncate(1);
    killed["interrupted"] = true.into();
    fs::write(out.join("summary.json"), killed.to_string()).expect("written");
    refused(&run(sheet, path, &["--resume", "--seed", "1"]), &["other than now", "--resume", "settings"]);
    succeeds(&run(sheet, path, &["--resume"]));
    let resumed = fs::read_to_string(out.join("frames.csv")).expect("rows");
    assert_eq!(resumed.lines().count(), whole.lines().count());
    let same = resumed.lines().zip(whole.lines()).take_while(|(a, b)| a == b).count();
    assert!(same > rows + 12 && same <= kept.len(), "{same} of {} rows are as before", kept.len());
    for (a, b) in resumed.lines().zip(whole.lines()) {
        assert_eq!(fixed(a), fixed(b));
    }
    let after = summary(&out);
    assert_eq!(after["interrupted"], false);
    assert_eq!(after["checks"]["differences"], 0);
    assert_eq!(after["scenes"][1]["images"], before["scenes"][1]["images"]);
}

/// Opens the report in Chromium, if there is one: the script runs without an error, and its switches work.
fn in_a_browser(report: &Path, folder: &Path) {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let starts = |name: &&str| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success());
    let Some(browser) = names.into_iter().find(starts) else {
        eprintln!("skipped: no Chromium, so the report was not opened in a browser");
        return;
    };
    let open = |page: &str| -> (String, Vec<String>) {
        let Output { stdout, stderr, .. } = Command::new(browser)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
            .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
            .args(["--enable-logging=stderr", "--dump-dom"])
            .arg(format!("--user-data-dir={}", folder.join("profile").display()))
            .arg(page)
            .output()
            .expect("it has started before");
        let log = String::from_utf8_lossy(&stderr);
        let errors = log.lines().filter(|line| line.contains(":CONSOLE")).map(str::to_owned).collect();
        (String::from_utf8_lossy(&stdout).into_owned(), errors)
    };
    let address = |path: PathBuf| format!("file://{}", path.display());

    let broken = folder.join("broken.html");
    fs::write(&broken, "<!DOCTYPE html><script>noSuchFunction()</script>").expect("written");
    let (_, errors) = open(&address(broken));
    assert!(!errors.is_empty(), "errors of a page are seen");

    let page = address(report.to_owned());
    let (dom, errors) = open(&page);
    assert_eq!(errors, Vec::<String>::new());
    assert!(dom.contains("data-script=\"ran\"") && !dom.contains("class=\"readout\""));
    assert_eq!(dom.matches("<p class=\"values\" role=\"status\"></p>").count(), 1, "of figure 4");
    assert!(!dom.contains("data-scene=\"sheet/\" hidden"), "all scenes at first");

    let (dom, errors) = open(&format!("{page}#scene=sheet%2F-2&strategies=refit%2Cauto&read=1"));
    assert_eq!(errors, Vec::<String>::new());
    assert!(dom.contains("data-script=\"ran\""));
    let has = |text: &str| assert!(dom.contains(text), "{text}");
    has("data-scene=\"sheet/\" hidden");
    assert!(!dom.contains("data-scene=\"sheet/-2\" hidden"));
    has("data-show=\"sheet/-2\" aria-pressed=\"true\"");
    has("data-toggle=\"auto\" aria-pressed=\"true\"");
    has("data-toggle=\"refit+rotate\" aria-pressed=\"false\"");
    let lines = |strategy: &str, off: bool| {
        let lines = dom.split("<path class=\"line ").skip(1).filter_map(|rest| rest.split_once('>'));
        let of = format!("data-strategy=\"{strategy}\"");
        lines.filter(|(tag, _)| tag.contains(&of) && tag.contains("data-off") == off).count()
    };
    // Two panels for each of two scenes.
    assert_eq!((lines("refit", false), lines("refit", true)), (4, 0));
    assert_eq!((lines("refit+rotate", false), lines("refit+rotate", true)), (0, 4));
    // The last frame's values, as in the data beside the lines.
    has("class=\"readout\" data-at=\"8\"");
    let read = dom.split("class=\"readout\"").nth(1).expect("a readout");
    let read = read.split("</g>").next().unwrap_or_default();
    assert!(read.contains(">frame 8<") && read.contains(">refit<") && read.contains(">auto<"), "{read}");
    assert!(!read.contains(">refit+rotate<"), "{read}");
    // The last bar that is on.
    has("<p class=\"values\" role=\"status\">sheet/-2, auto: ");
}
