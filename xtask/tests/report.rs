//! What a run leaves behind, used again: resumed, drawn again, seen in a browser.

mod program;

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use program::{Running, folder, refused, rows, str, succeeds};
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

/// Opens the report at the widths of a phone, a tablet and a desktop, in light and dark, and checks
/// there what `report.js` beside this file checks.
fn seen_in_a_browser(report: &str, folder: &Path) {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let Some(browser) = names.into_iter().find(|name| Command::new(name).arg("--version").output().is_ok())
    else {
        return println!("skipped: no Chromium to see the report in");
    };
    let [page, plain] = ["page.html", "plain.html"].map(|name| folder.join(name));
    let script = format!("<script>{}</script></body>", include_str!("report.js"));
    fs::write(&page, report.replace("</body>", &script)).expect("written");
    fs::write(&plain, report).expect("written");
    let run = |page: &Path, size: &str, scheme: &str, more: &str| {
        let output = Command::new(browser)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=3000"])
            .arg(format!("--user-data-dir={}", folder.join("profile").display()))
            .arg(format!("--window-size={size}"))
            .arg(format!("--blink-settings=preferredColorScheme={scheme}"))
            .arg(more)
            .arg(format!("file://{}", page.display()))
            .output();
        String::from_utf8_lossy(&output.expect("a browser").stdout).into_owned()
    };
    for size in ["390,844", "900,900", "1600,900"] {
        let dom = run(&page, size, "1", "--dump-dom");
        let title = dom.split_once("<title>").and_then(|(_, rest)| rest.split_once("</title>"));
        assert_eq!(title.map(|(title, _)| title), Some("failed: ."), "at {size}");
        let shots = ["0", "1"].map(|scheme| {
            let shot = folder.join(format!("shot-{scheme}.png"));
            run(&plain, size, scheme, &format!("--screenshot={}", shot.display()));
            fs::read(shot).expect("a screenshot")
        });
        let sizes = shots.each_ref().map(Vec::len);
        assert!(
            sizes.iter().all(|&size| size > 10_000) && shots[0] != shots[1],
            "at {size}: {sizes:?} bytes"
        );
    }
}

/// An interrupt keeps what was measured, and the way to go on that is named works.
#[cfg(unix)]
#[test]
fn an_interrupted_run_says_how_to_go_on() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("results");
    let [sheet, path] = [str(&sheet), str(&out)];
    let all = ["reproduce", "fig6", "--preset", "quick", "--scene", sheet, "--loops", "900", "--out", path];
    let run = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(all)
        .stderr(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn();
    let run = Running::new(run);
    let rows = || fs::read_to_string(out.join("frames.csv")).map_or(0, |rows| rows.lines().count());
    let start = Instant::now();
    while rows() < 100 {
        assert!(start.elapsed() < Duration::from_secs(60), "no rows");
        sleep(Duration::from_millis(20));
    }
    Command::new("kill").args(["-INT", &run.id().to_string()]).status().expect("kill");
    let ended = run.wait_with_output().expect("the end");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(130), "{said}");
    assert_eq!(String::from_utf8_lossy(&ended.stdout).trim(), format!("{path}/report.html"), "no verdicts");
    refused(&all, &["unfinished run", "--resume", "--out"]);
    let command =
        said.lines().find_map(|line| line.split_once("Go on with: cargo xtask ")).expect("how to go on").1;
    assert!(command.ends_with("--resume"), "{said}");
    assert!(
        fs::read_to_string(out.join("report.html")).expect("a report").contains("The run was interrupted.")
    );
    let kept = rows();
    let resumed =
        Command::new(env!("CARGO_BIN_EXE_xtask")).args(command.split(' ')).stderr(Stdio::piped()).spawn();
    let resumed = Running::new(resumed);
    while rows() <= kept + 20 {
        assert!(
            start.elapsed() < Duration::from_secs(120),
            "{} rows, no more than the {kept} before",
            rows()
        );
        sleep(Duration::from_millis(20));
    }
    Command::new("kill").args(["-INT", &resumed.id().to_string()]).status().expect("kill");
    let ended = resumed.wait_with_output().expect("the end");
    assert_eq!(ended.status.code(), Some(130), "{}", String::from_utf8_lossy(&ended.stderr));
}

#[test]
fn results_are_resumed_and_drawn_again() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("results");
    let [sheet, path] = [str(&sheet), str(&out)];
    succeeds(&run(sheet, path, &[]));
    let whole = fs::read_to_string(out.join("frames.csv")).expect("rows");
    let (before, untimed) = (summary(&out), rows(&out.join("frames.csv")));
    let verdicts = |summary: &Value| -> Vec<Value> {
        summary["claims"].as_array().expect("claims").iter().map(|c| c["verdict"].clone()).collect()
    };

    // Drawn again elsewhere: the same claims, pictures, figures and page.
    let redrawn = temporary.path().join("redrawn");
    succeeds(&["reproduce", "--from", path, "--out", str(&redrawn)]);
    let after = summary(&redrawn);
    assert_eq!(verdicts(&after), verdicts(&before));
    assert_eq!(after["scenes"][1]["images"], before["scenes"][1]["images"]);
    let names = |folder: &Path| -> Vec<_> {
        let figures = fs::read_dir(folder.join("figures")).expect("figures");
        let mut names: Vec<_> = figures.map(|file| file.expect("a figure").file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(names(&redrawn), names(&out));
    for name in names(&out) {
        let figure = |folder: &Path| fs::read(folder.join("figures").join(&name)).expect("a figure");
        assert!(figure(&redrawn) == figure(&out), "{}", name.display());
    }
    let page = |folder: &Path| fs::read_to_string(folder.join("report.html")).expect("a report");
    assert!(page(&redrawn) == page(&out), "the report drawn again is another one");
    // Published results have no pictures; otherwise none may be missing.
    let mut images = fs::read_dir(redrawn.join("images")).expect("images");
    fs::remove_file(images.next().expect("one").expect("readable").path()).expect("a file");
    let other = temporary.path().join("again");
    let again = ["reproduce", "--from", str(&redrawn), "--out", str(&other)];
    refused(&again, &["images", "cannot be read"]);
    fs::remove_dir_all(redrawn.join("images")).expect("a folder");
    succeeds(&again);

    let report = page(&out);
    assert!(
        report.matches("<svg").count() >= 3
            && report.matches("<script").count() == 1
            && ["src=\"http", "href=\"http", "url(", "@import", "<link"]
                .iter()
                .all(|out| !report.contains(out))
    );
    seen_in_a_browser(&report, temporary.path());

    // Killed in the second scene, in the middle of a row, and gone on with.
    let first = whole.lines().filter(|line| line.starts_with("sheet/,")).count();
    let kept: Vec<_> = whole.lines().take(1 + first + 40).collect();
    fs::write(out.join("frames.csv"), format!("{}\nsheet/-2,ref", kept.join("\n"))).expect("written");
    let mut killed = before.clone();
    killed["scenes"].as_array_mut().expect("scenes").truncate(1);
    killed["interrupted"] = true.into();
    fs::write(out.join("summary.json"), killed.to_string()).expect("written");
    refused(&run(sheet, path, &["--resume", "--seed", "1"]), &["other than now", "--out", "settings"]);
    let (_elsewhere, namesake) = folder();
    refused(&run(str(&namesake), path, &["--resume"]), &["other than now", "scenes"]);
    succeeds(&run(sheet, path, &["--resume"]));
    let resumed = fs::read_to_string(out.join("frames.csv")).expect("rows");
    let same = resumed.lines().zip(whole.lines()).take_while(|(a, b)| a == b).count();
    assert!(same > first + 12 && same <= kept.len(), "{same} of {} rows are as before", kept.len());
    // Trees from the background depend on time.
    let is_timeless = |row: &str| !row.contains("asynchronous") && !row.contains("background");
    let now = rows(&out.join("frames.csv"));
    assert_eq!(now.len(), untimed.len());
    for (now, before) in now.iter().zip(&untimed).filter(|(row, _)| is_timeless(row)) {
        assert_eq!(now, before);
    }
    let after = summary(&out);
    assert_eq!(after["interrupted"], false);
    assert_eq!(after["checks"]["differences"], 0);
    assert_eq!(after["scenes"][1]["images"], before["scenes"][1]["images"]);
}
