//! What a run leaves behind, used again: resumed, drawn again, compared.

mod program;

use std::fs;
use std::path::Path;

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
fn results_are_resumed_redrawn_and_compared() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("results");
    let [sheet, path] = [str(&sheet), str(&out)];
    succeeds(&run(sheet, path, &[]));
    let whole = fs::read_to_string(out.join("frames.csv")).expect("rows");
    let before = summary(&out);
    let verdicts = |summary: &Value| -> Vec<Value> {
        summary["claims"].as_array().expect("claims").iter().map(|c| c["verdict"].clone()).collect()
    };

    // Drawn again elsewhere: the same claims, figures and pictures, and the same page but for
    // rounding.
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

    let report = fs::read_to_string(out.join("report.html")).expect("a report");
    assert!(
        report.matches("<svg").count() >= 3
            && !report.contains("<script")
            && !report.contains("http://www.w3.org/1999")
    );

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
    // Trees from the background depend on time.
    for (a, b) in resumed.lines().zip(whole.lines()).filter(|(a, _)| !a.contains("asynchronous")) {
        assert_eq!(fixed(a), fixed(b));
    }
    let after = summary(&out);
    assert_eq!(after["interrupted"], false);
    assert_eq!(after["checks"]["differences"], 0);
    assert_eq!(after["scenes"][1]["images"], before["scenes"][1]["images"]);
}
