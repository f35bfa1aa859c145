//! Full disks, unreadable files and killed runs: nothing half-written is ever taken for whole,
//! measured rows survive.
//!
//! The system provokes them: `ulimit -f` ends a write in the middle of a file, by an error or by a
//! signal; SIGKILL ends a process at any moment.
#![cfg(target_os = "linux")]

mod program;

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::os::unix::fs::symlink;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use program::{Running, folder, refused, rows, str, succeeds};

/// The program, started by a shell after some `preparation`.
fn after(preparation: &str, arguments: &[&str]) -> Output {
    let script = format!("{preparation}; exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_xtask")]).args(arguments);
    command.output().expect("a shell")
}

/// Fails with exit code 2 and one line that has all of `words`.
fn fails(output: &Output, words: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    let last = message.lines().last().expect("a message");
    assert!(last.starts_with("error: ") && message.matches("error: ").count() == 1, "{message}");
    for word in words {
        assert!(last.contains(word), "no {word:?} in {message}");
    }
}

/// A run of both kinds of rows.
fn reproduce<'a>(sheet: &'a Path, out: &'a Path) -> Vec<&'a str> {
    reproduce_frames(sheet, out, "100")
}

fn reproduce_frames<'a>(sheet: &'a Path, out: &'a Path, frames: &'a str) -> Vec<&'a str> {
    let mut all =
        vec!["reproduce", "fig4", "fig5", "--preset", "quick", "--scene", str(sheet), "--out", str(out)];
    all.extend(["--strategy", "refit", "--strategy", "refit+rotate", "--threads", "1"]);
    all.extend(["--frames", frames, "--loops", "1.5", "--size", "8"]);
    all
}

/// The least run.
fn reproduce_refit<'a>(sheet: &'a Path, out: &'a Path) -> Vec<&'a str> {
    let all = ["reproduce", "fig4", "--preset", "quick", "--scene", str(sheet), "--out", str(out)];
    [&all[..], &["--strategy", "refit", "--frames", "5", "--size", "8"]].concat()
}

fn resumed<'a>(sheet: &'a Path, out: &'a Path) -> Vec<&'a str> {
    [reproduce(sheet, out), vec!["--resume"]].concat()
}

const FILES: [&str; 2] = ["frames.csv", "fig5.csv"];

/// The rows of a run that nothing happened to.
fn undisturbed(sheet: &Path, base: &Path) -> [Vec<String>; 2] {
    let out = base.join("undisturbed");
    succeeds(&reproduce(sheet, &out));
    let rows = FILES.map(|name| rows(&out.join(name)));
    assert_eq!(rows.each_ref().map(Vec::len), [1 + 2 * 150, 1 + (5 * 20 + 100 + 500) * 3 / 2]);
    rows
}

fn is_whole(out: &Path, all: &[Vec<String>; 2]) {
    assert_eq!(&FILES.map(|name| rows(&out.join(name))), all);
    let summary = fs::read(out.join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_slice(&summary).expect("JSON");
    assert_eq!((&summary["interrupted"], &summary["checks"]["differences"]), (&false.into(), &0.into()));
    assert_eq!(summary["scenes"][0]["images"].as_array().expect("a list").len(), 3 * 3);
    assert!(fs::read_to_string(out.join("report.html")).expect("a report").ends_with("</html>"));
}

/// Waits for what has to come.
fn wait_for(what: &str, mut is_there: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !is_there() {
        assert!(begun.elapsed() < Duration::from_secs(60), "no {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Interrupts a process or, by its negative number, a group of processes.
fn interrupt(target: &str) {
    assert!(Command::new("kill").args(["-s", "INT", "--", target]).status().expect("kill").success());
}

fn lines(file: &Path) -> usize {
    fs::read(file).map_or(0, |bytes| bytes.iter().filter(|&&byte| byte == b'\n').count())
}

/// Starts a run and kills it in time; whether it ran as long as that.
fn killed_when(arguments: &[&str], mut it_is_time: impl FnMut() -> bool) -> bool {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command.args(arguments).stdout(Stdio::null()).stderr(Stdio::null());
    let mut run = Running::new(command.spawn());
    let mut ended = false;
    wait_for("rows", || {
        ended = run.try_wait().expect("a child").is_some();
        ended || it_is_time()
    });
    run.kill().expect("killed");
    run.wait().expect("a child").code().is_none()
}

/// Names of files in a folder and those in it that no finished run would leave.
fn half_written(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            found.extend(half_written(&path));
        } else if str(&path).ends_with(".partial") {
            found.push(path);
        }
    }
    found
}

#[test]
fn rows_survive_a_full_disk_and_a_signal_in_the_middle_of_a_row() {
    let (temporary, sheet) = folder();
    let all = undisturbed(&sheet, temporary.path());
    // In blocks of 512 bytes: shorter than the rows of figure 4, and than those of figure 5.
    for (file, blocks) in [(0, 50), (1, 200)] {
        for signal in [true, false] {
            let out = temporary.path().join(format!("{file}-{signal}"));
            let ignore = if signal { ":" } else { "trap '' XFSZ" };
            let output =
                after(&format!("{ignore}; ulimit -c 0; ulimit -f {blocks}"), &reproduce(&sheet, &out));
            if signal {
                assert!(output.status.signal().is_some(), "{:?}", output.status);
                assert_eq!(fs::metadata(out.join(FILES[file])).expect("rows").len(), 512 * blocks, "torn");
            } else {
                fails(&output, &[FILES[file], "too large"]);
                assert!(fs::read(out.join(FILES[file])).expect("rows").ends_with(b"\n"), "whole rows only");
                assert_eq!(half_written(&out), [] as [PathBuf; 0]);
            }
            assert!(!out.join("report.html").exists());
            let left = FILES.map(|name| rows(&out.join(name)));
            assert!(left[file].len() > 50 && all[file].starts_with(&left[file]));
            assert_eq!(left[0].len() == all[0].len(), file == 1, "all rows of what was finished before");

            succeeds(&resumed(&sheet, &out));
            is_whole(&out, &all);
        }
    }
}

#[test]
fn rows_survive_a_run_that_is_killed_and_killed_again() {
    let (temporary, sheet) = folder();
    let all = undisturbed(&sheet, temporary.path());
    let out = temporary.path().join("killed");
    let mut before = 0;
    for (file, count) in [(0, 10), (0, 120), (1, 30), (1, 400)] {
        let run = if before == 0 { reproduce(&sheet, &out) } else { resumed(&sheet, &out) };
        if !killed_when(&run, || lines(&out.join(FILES[file])) >= count) {
            // On a busy machine a run may end before it is looked at again.
            break;
        }
        let left = FILES.map(|name| rows(&out.join(name)));
        for (left, all) in left.iter().zip(&all) {
            assert!(all.starts_with(left), "rows, in order");
        }
        let count = left.iter().map(Vec::len).sum::<usize>();
        // Of those of the last step, which may be incomplete, a resumed run measures all again.
        assert!(count + 4 >= before, "{count} rows of {before}");
        before = count;
        // What can be read of it is a run that says it is not finished.
        let summary = fs::read(out.join("summary.json")).expect("a summary");
        let summary: serde_json::Value = serde_json::from_slice(&summary).expect("JSON");
        assert_eq!(summary["interrupted"], true);
    }
    assert!(before > 0, "killed at least once");
    succeeds(&resumed(&sheet, &out));
    is_whole(&out, &all);
}

/// A scene that is not finished is measured again. What is of finished scenes is kept, byte by
/// byte.
#[test]
fn points_and_peers_survive_a_run_that_is_killed_in_either_scene() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("killed");
    let run = ["reproduce", "accuracy", "peers", "--preset", "quick", "--out", str(&out)];
    let twice = ["--scene", str(&sheet), "--scene", str(&sheet)];
    let run = [&run[..], &twice, &["--frames", "3", "--size", "8", "--threads", "1"]].concat();
    let files = ["accuracy.csv", "peers.csv"].map(|name| out.join(name));
    let of = |scene: &str| {
        files.each_ref().map(|file| {
            let text = fs::read_to_string(file).expect("rows");
            let whole = text.split_inclusive('\n').filter(|line| line.ends_with('\n'));
            let rows = whole.filter_map(|line| line.strip_prefix(&format!("{scene},")));
            rows.map(str::to_owned).collect::<Vec<_>>()
        })
    };
    assert!(killed_when(&run, || lines(&files[0]) > 5));
    let resume = [&run[..], &["--resume"]].concat();
    assert!(killed_when(&resume, || lines(&files[1]) > 1 && !of("sheet/-2")[0].is_empty()));
    let first = of("sheet/");
    succeeds(&resume);
    assert!(of("sheet/") == first);
    for file in &files {
        let rows = fs::read_to_string(file).expect("rows");
        let (less, _) = rows.trim_end().rsplit_once('\n').expect("lines");
        fs::write(file, format!("{less}\n")).expect("a file");
        refused(&resume, &[str(file), "summary.json counted"]);
        fs::write(file, rows).expect("a file");
    }
    // What is not measured: each of these is of one row.
    let is_text = |field: &&str| !field.is_empty() && field.parse::<f64>().is_err();
    let words = |row: &String| row.trim_end().split(',').filter(is_text).collect::<Vec<_>>().join(",");
    for (first, second) in first.iter().zip(of("sheet/-2")) {
        let distinct = first.iter().map(words).collect::<BTreeSet<_>>();
        assert!(first.len() > 5 && distinct.len() == first.len(), "rows are there twice: {first:#?}");
        let distinct = second.iter().map(words).collect::<BTreeSet<_>>();
        assert_eq!((distinct.len(), second.len()), (first.len(), first.len()), "{second:#?}");
    }
}

/// Loading comes first, and files cannot be interrupted while they load.
#[test]
fn an_interrupt_while_files_load_keeps_what_finished_scenes_have() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("results");
    for i in 3..3000 {
        symlink("sheet0.ply", sheet.join(format!("sheet{i}.ply"))).expect("a link");
    }
    let run = reproduce_refit(&sheet, &out);
    succeeds(&run);
    let scenes = || {
        let summary = fs::read(out.join("summary.json")).expect("a summary");
        serde_json::from_slice::<serde_json::Value>(&summary).expect("JSON")["scenes"].clone()
    };
    let before = scenes();
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    let run = Running::new(command.args(&run).arg("--resume").stderr(Stdio::null()).spawn());
    let status = format!("/proc/{}/status", run.id());
    wait_for("handler", || {
        let status = fs::read_to_string(&status).expect("a process");
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).expect("signals");
        // The bit of signal 2, SIGINT.
        u64::from_str_radix(caught.trim(), 16).expect("a mask") & 2 != 0
    });
    interrupt(&run.id().to_string());
    assert_eq!(run.wait_with_output().expect("a child").status.code(), Some(130));
    assert_eq!(scenes(), before);
}

/// A new run in the folder of a finished one, killed before its first scene is through, is not
/// taken for that one.
#[test]
fn an_old_summary_does_not_speak_for_new_rows() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("again");
    let run = reproduce(&sheet, &out);
    succeeds(&run);
    // It fails while it writes the header of the new rows.
    fails(&after("trap '' XFSZ; ulimit -f 0", &run), &["too large"]);
    assert!(!out.join("summary.json").exists() && !out.join("report.html").exists());
    succeeds(&resumed(&sheet, &out));
    is_whole(&out, &undisturbed(&sheet, temporary.path()));
}

#[test]
fn a_full_disk_leaves_no_half_file_and_the_report_can_be_drawn_later() {
    let (temporary, sheet) = folder();
    let base = temporary.path();
    // In blocks of 512 bytes: room for rows and pictures, but not for the report with all pictures
    // in it.
    let full = "trap '' XFSZ; ulimit -f 40";
    let out = base.join("out");
    let run = reproduce_refit(&sheet, &out);
    fails(&after(full, &run), &["too large"]);
    assert!(!out.join("report.html").exists() && half_written(&out).is_empty());
    succeeds(&run);
    fs::remove_file(out.join("report.html")).expect("a report");
    succeeds(&["reproduce", "--from", str(&out)]);
    assert!(fs::read_to_string(out.join("report.html")).expect("a report").ends_with("</html>"));
    assert_eq!(rows(&out.join("frames.csv")).len(), 1 + 8, "1.5 loops of 5 frames");

    // The rows of one folder, copied to another: all of the file or none.
    let copy = base.join("copy");
    fails(
        &after("trap '' XFSZ; ulimit -f 0", &["reproduce", "--from", str(&out), "--out", str(&copy)]),
        &["frames.csv"],
    );
    assert!(!copy.join("frames.csv").exists() && half_written(&copy).is_empty());
}

#[test]
fn a_run_removes_what_a_killed_one_has_left_half_written() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("out");
    let run = reproduce_refit(&sheet, &out);
    let killed = after("ulimit -c 0; ulimit -f 40", &run);
    assert!(killed.status.signal().is_some() && half_written(&out).len() == 1, "{killed:?}");
    for folder in ["figures", "images"] {
        fs::write(out.join(folder).join(".pivot-123456.partial"), "half").expect("a file");
    }
    succeeds(&run);
    assert_eq!(half_written(&out), [] as [PathBuf; 0]);
}

/// An interrupt reaches the case that runs as well, whose end then says nothing of the library.
#[test]
fn an_interrupt_of_the_hard_cases_accuses_nobody() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command.args(["compare", "hard"]).process_group(0).stdout(Stdio::piped()).stderr(Stdio::piped());
    let run = Running::new(command.spawn());
    let children = format!("/proc/{0}/task/{0}/children", run.id());
    wait_for("case", || !fs::read_to_string(&children).expect("a process").is_empty());
    interrupt(&format!("-{}", run.id()));
    let output = run.wait_with_output().expect("a child");
    let (printed, message) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(130), "{message}");
    assert!(!printed.contains("fails") && !printed.contains("crashes"), "{printed}");
    assert!(!message.contains("error: "), "{message}");
}

/// The first interrupt stops a run after its step. Here it cannot end then, since nobody reads what
/// it prints.
#[test]
fn a_second_interrupt_ends_a_run_at_once() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("results");
    let (_unread, mut full) = std::io::pipe().expect("a pipe");
    let stdout = full.try_clone().expect("a pipe");
    std::thread::spawn(move || while full.write_all(&[b'\n'; 4096]).is_ok() {});
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    let arguments = reproduce_frames(&sheet, &out, "5000");
    let mut run = Running::new(command.args(arguments).stdout(stdout).stderr(Stdio::null()).spawn());
    wait_for("rows", || lines(&out.join("frames.csv")) > 10);
    interrupt(&run.id().to_string());
    wait_for("report", || out.join("report.html").exists());
    assert!(run.try_wait().expect("a child").is_none(), "the first interrupt ends the run");
    interrupt(&run.id().to_string());
    let mut status = None;
    wait_for("end", || {
        status = run.try_wait().expect("a child");
        status.is_some()
    });
    assert_eq!(status.and_then(|status| status.code()), Some(130));
}

#[test]
fn standard_streams_that_cannot_be_written_lose_nothing() {
    let (temporary, sheet) = folder();
    fails(&after("exec >/dev/full", &["list"]), &["standard output", "No space"]);
    fails(&after("exec >/dev/full", &["list", "--json"]), &["standard output", "No space"]);
    for (redirect, code) in [("exec >/dev/full", 2), ("exec 2>/dev/full", 0), ("exec 2>&-", 0)] {
        let out = temporary.path().join(redirect.replace('/', "-"));
        let output = after(redirect, &reproduce_frames(&sheet, &out, "3"));
        assert_eq!(
            output.status.code(),
            Some(code),
            "{redirect}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        assert!(out.join("report.html").exists() && rows(&out.join("fig5.csv")).len() > 100, "{redirect}");
    }
    // Bad input has its exit code, even if no message can be printed.
    let output = after("exec 2>/dev/full", &["render", "no-such-scene"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn what_cannot_be_read_is_refused() {
    let (temporary, sheet) = folder();
    let base = temporary.path();
    let at = |name: &str| base.join(name);
    let out = at("a.png");
    let first = fs::read(sheet.join("sheet0.ply")).expect("a mesh");
    fs::create_dir(at("folder.ply")).expect("a folder");
    fs::write(at("empty.ply"), "").expect("a file");
    fs::write(at("cut.ply"), &first[..first.len() / 2]).expect("a file");
    symlink("nowhere", at("dangling.ply")).expect("a link");
    symlink("loop.ply", at("loop.ply")).expect("a link");
    symlink("/dev/zero", at("endless.ply")).expect("a link");
    symlink("/dev/zero", at("endless.glb")).expect("a link");
    let made = Command::new("mkfifo").args([at("pipe.ply"), at("pipe.gltf"), at("pipe.bin")]).status();
    assert!(made.expect("mkfifo").success());
    let gltf = r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"URI","byteLength":1000000000000}]}"#;
    symlink("/etc/passwd", at("link.bin")).expect("a link");
    for (name, uri) in [
        ("missing.gltf", "missing.bin"),
        ("piped.gltf", "pipe.bin"),
        ("foldered.gltf", "."),
        ("linked.gltf", "link.bin"),
    ] {
        fs::write(at(name), gltf.replace("URI", uri)).expect("a file");
    }
    for frames in ["dangling", "piped", "truncated"] {
        fs::create_dir(at(frames)).expect("a folder");
        for i in 0..2 {
            fs::write(at(frames).join(format!("f{i}.ply")), &first).expect("a file");
        }
    }
    symlink("nowhere", at("dangling/f2.ply")).expect("a link");
    let made = Command::new("mkfifo").arg(at("piped/f2.ply")).status();
    assert!(made.expect("mkfifo").success());
    fs::write(at("truncated/f2.ply"), &first[..first.len() - 20]).expect("a file");

    for (name, words) in [
        ("folder.ply", vec!["folder.ply"]),
        ("empty.ply", vec!["empty.ply"]),
        ("cut.ply", vec!["cut.ply", "expected"]),
        ("dangling.ply", vec!["dangling.ply"]),
        ("loop.ply", vec!["loop.ply"]),
        ("endless.ply", vec!["endless.ply", "expected a regular file"]),
        ("endless.glb", vec!["endless.glb"]),
        ("pipe.ply", vec!["pipe.ply", "expected a regular file"]),
        ("pipe.gltf", vec!["pipe.gltf"]),
        ("missing.gltf", vec!["missing.bin"]),
        ("piped.gltf", vec!["pipe.bin"]),
        ("foldered.gltf", vec!["gltf"]),
        ("linked.gltf", vec!["link.bin", "leads out of the folder"]),
        ("dangling", vec!["f2.ply"]),
        ("piped", vec!["f2.ply"]),
        ("truncated", vec!["f2.ply", "expected"]),
    ] {
        let words = [words, vec![str(base)]].concat();
        refused(&["render", str(&at(name)), "--out", str(&out)], &words);
        assert!(!out.exists());
    }
}

/// A small file may declare any amount of geometry. The whole command keeps to a limit, or refuses
/// the file at once.
#[test]
fn memory_of_a_whole_render_is_in_proportion_to_its_files() {
    let temporary = tempfile::TempDir::new().expect("a folder");
    let at = |name: &str| temporary.path().join(name);
    let out = at("a.png");
    let gltf = |indices: usize| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"uri":"data:;base64,{}","byteLength":36}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
            {{"componentType":5125,"count":{indices},"type":"SCALAR"}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],"nodes":[{{"mesh":0}}]}}"#,
            "A".repeat(48)
        )
    };
    let view = "v\nfrom 0 0 5\nat 0 0 0\nup 0 1 0\nangle 40\nhither 1\nresolution 8 8\n";
    fs::write(at("few.gltf"), gltf(6_000_000)).expect("a file");
    fs::write(at("many.gltf"), gltf(30_000_000)).expect("a file");
    fs::write(at("few.aff"), view.to_owned() + &"s 1 0 0 0\n".repeat(5000)).expect("a file");
    fs::write(at("many.aff"), view.to_owned() + &"s 1 0 0 0\n".repeat(90_000)).expect("a file");
    let render = |name: &str| {
        // In KiB, of address space.
        after(
            "ulimit -v 2500000",
            &["render", str(&at(name)), "--size", "8x8", "--threads", "1", "--out", str(&out)],
        )
    };
    for few in ["few.gltf", "few.aff"] {
        let output = render(few);
        assert!(output.status.success(), "{output:?}");
    }
    fails(&render("many.gltf"), &["many.gltf", "expected at most"]);
    fails(&render("many.aff"), &["many.aff", "expected at most"]);
}

#[test]
fn damaged_results_are_refused_and_left_alone() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("results");
    let run = reproduce_frames(&sheet, &out, "3");
    let resume = [&run[..], &["--resume"]].concat();
    succeeds(&run);
    let fresh = ["reproduce", "--from", str(&out)];
    let damaged = |name: &str, content: &[u8], words: &[&str]| {
        let path = out.join(name);
        let whole = fs::read(&path).expect("results");
        fs::write(&path, content).expect("a file");
        refused(&resume, words);
        refused(&fresh, words);
        assert_eq!(fs::read(&path).expect("the same"), content);
        fs::write(&path, whole).expect("a file");
    };
    let summary = fs::read(out.join("summary.json")).expect("a summary");
    for cut in [0, 1, 9, summary.len() / 3, summary.len() - 2] {
        damaged("summary.json", &summary[..cut], &["summary.json"]);
    }
    damaged("summary.json", &vec![0; summary.len()], &["summary.json"]);
    damaged("frames.csv", b"scene,strategy\n1,2\n", &["frames.csv", "not rows"]);
    damaged("fig5.csv", &[0xff; 400], &["fig5.csv"]);
    for name in FILES {
        let rows = fs::read(out.join(name)).expect("rows");
        let last = rows[..rows.len() - 1].iter().rposition(|&byte| byte == b'\n').expect("lines");
        for cut in [0, last + 1, rows.len() - 1] {
            damaged(name, &rows[..cut], &[name, "summary.json counted"]);
        }
    }

    for name in ["frames.csv", "images/sheet-0000.png"] {
        let (path, aside) = (out.join(name), out.join("aside"));
        fs::rename(&path, &aside).expect("moved");
        fs::create_dir(&path).expect("a folder");
        refused(&resume, &[name, "cannot be read"]);
        refused(&fresh, &[name, "cannot be read"]);
        fs::remove_dir(&path).expect("empty");
        fs::rename(&aside, &path).expect("moved");
    }
    succeeds(&resume);
    succeeds(&fresh);
}

#[test]
fn what_cannot_be_replaced_is_left_alone() {
    let (temporary, sheet) = folder();
    let base = temporary.path();
    let device = base.join("device.json");
    symlink("/dev/null", &device).expect("a link");
    for json in [base, &device] {
        let json = ["compare", "build", "--scene", str(&sheet), "--json", str(json)];
        refused(&json, &[json[5], "no regular file"]);
    }
    assert!(device.is_symlink());
    for name in ["frames.csv", "summary.json", "report.html", "images"] {
        let out = base.join(name.replace('.', "-"));
        fs::create_dir(&out).expect("a folder");
        fs::write(out.join(".pivot-lock"), "").expect("a file");
        if name == "images" {
            fs::write(out.join(name), "in the way").expect("a file");
        } else {
            fs::create_dir(out.join(name)).expect("a folder");
        }
        refused(&reproduce(&sheet, &out), &[name]);
    }
    // A picture of somebody else's, by a name that a run would remove.
    let own = base.join("own");
    fs::create_dir_all(own.join("images")).expect("a folder");
    fs::write(own.join("images/holiday-1234.png"), "").expect("a file");
    // As other tools leave them.
    fs::write(own.join(".lock"), "").expect("a file");
    fs::write(own.join("summary.json"), "{}").expect("a file");
    refused(&reproduce(&sheet, &own), &["own", "no results", "--out"]);
    assert!(own.join("images/holiday-1234.png").exists());
    let dangling = base.join("dangling");
    symlink("nowhere/at-all", &dangling).expect("a link");
    refused(&reproduce(&sheet, &dangling), &["dangling", "folder"]);
}
