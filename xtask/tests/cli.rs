//! The program as users run it: exit codes, messages, and the files it leaves.

mod program;

use std::fs;
use std::path::Path;

use program::{folder, refused, rows, str, succeeds};

/// The columns that scripts rely on, in order; more may follow.
const COLUMNS: &str = "scene,strategy,threads,loop,frame,animate_ms,update_ms,trace_ms,frame_ms,sah_cost,rotations,\
                       height,nodes_visited,rays_primary,rays_shadow,hits,";

#[test]
fn bad_input_is_refused_in_one_line_that_helps() {
    let (temporary, sheet) = folder();
    let (sheet, base) = (str(&sheet), temporary.path());
    let (out, broken, file) = (base.join("out"), base.join("broken.glb"), base.join("file"));
    fs::write(&broken, b"glTF\x02\0\0\0 and then nothing of the kind").expect("a file");
    fs::write(&file, "in the way").expect("a file");
    let (out, broken, below_file) = (str(&out), str(&broken), file.join("below"));
    let reproduce = |more: &[&str]| {
        let mut all = vec!["reproduce", "--out", out];
        all.extend(more);
        all.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>()
    };
    for (more, words) in [
        (vec!["accuracy-of-nothing"], vec!["accuracy-of-nothing", "fig4", "fig6"]),
        (vec!["--preset", "slow"], vec!["slow", "quick", "standard", "full"]),
        (vec!["--scene", "no-such-scene"], vec!["no-such-scene", "n-body"]),
        (vec!["--scene", "no/such/file.glb"], vec!["no/such/file.glb"]),
        (vec!["--scene", broken], vec!["broken.glb"]),
        (vec!["--strategy", "hope"], vec!["hope", "refit+rotate", "ideal"]),
        (vec!["--scene", sheet, "--clip", "walk"], vec!["walk", "no clip"]),
        (vec!["--clip", "walk"], vec!["--clip", "--scene"]),
        (vec!["--frames", "0"], vec!["0", "--frames"]),
        (vec!["--loops", "0"], vec!["--loops", "above 0"]),
        (vec!["--loops", "nan"], vec!["--loops"]),
        (vec!["--loops", "-1"], vec!["--loops", "above 0"]),
        (vec!["--frames", "-1"], vec!["--frames", "-1", "1..="]),
        (vec!["fig5", "--strategy", "lbvh"], vec!["--strategy", "fig4"]),
        (vec!["accuracy", "--strategy", "lbvh"], vec!["--strategy", "fig4"]),
        (vec!["fig5", "--frames", "9"], vec!["--frames", "accuracy"]),
        (vec!["accuracy", "peers", "--loops", "2"], vec!["--loops", "fig5"]),
        (vec!["fig4", "--embree", sheet], vec!["--embree", "peers"]),
        (vec!["--embree", sheet], vec!["--embree", "peers"]),
        (vec!["peers", "--scene", sheet, "--embree", "no/such/place"], vec!["no/such/place"]),
        (vec!["--size", "0"], vec!["0", "--size"]),
        (vec!["--threads", "0"], vec!["0", "--threads"]),
        (vec!["--threads", "many"], vec!["many", "--threads"]),
        (vec!["--from", "no/such/folder"], vec!["no/such/folder", "reproduce"]),
        (vec!["--from", sheet, "--frames", "3"], vec!["--from", "--frames"]),
        (vec!["--from", sheet, "--preset", "full"], vec!["--from", "--preset"]),
        (vec!["--from", sheet, "--seed", "9"], vec!["--from", "--seed"]),
        (vec!["--from", sheet, "--embree", sheet], vec!["--from", "--embree"]),
    ] {
        let all = reproduce(&more);
        refused(&all.iter().map(String::as_str).collect::<Vec<_>>(), &words);
    }
    assert!(!Path::new(out).exists(), "refused before anything is made");
    refused(&["reproduce", "--scene", sheet, "--out", str(&below_file)], &["below"]);
    refused(&["repeat"], &["repeat"]);
    refused(&["export", "lion", "lion.glb"], &["lion", "fairy-forest"]);
    refused(&["export", "fairy-forest", "forest.obj"], &["forest.obj", ".glb"]);
    refused(&["export", "toys", "toys.glb", "--seed", "1"], &["--seed", "toys"]);

    let json = base.join("compare.json");
    for (more, words) in [
        (vec!["build", "--scene", sheet, "--scene", "no-such-scene"], vec!["no-such-scene", "n-body"]),
        (vec!["build", "--scene", sheet, "--embree", "no/such/place"], vec!["no/such/place"]),
        (vec!["build", "--scene", sheet, "--only", "nobody"], vec!["--only nobody", "pivot lbvh"]),
        (vec!["build", "--scene", sheet, "--runs", "2"], vec!["--runs", "frame"]),
        (vec!["build", "--scene", sheet, "--size", "9"], vec!["--size", "trace"]),
        (vec!["update", "--scene", sheet, "--size", "9"], vec!["--size", "trace"]),
        (vec!["frame", "--scene", sheet, "--runs", "0"], vec!["0", "--runs"]),
        (vec!["hard"], vec!["--json", "hard"]),
    ] {
        let mut all = vec!["compare"];
        all.extend(more);
        all.extend(["--json", str(&json)]);
        refused(&all, &words);
    }
    refused(&["compare", "update", "--from", str(&json)], &["--from", "--chart"]);
    refused(&["compare", "--beside", str(&json)], &["--from"]);
    for option in ["--frames", "--threads", "--size", "--scene", "--runs", "--only"] {
        refused(&["compare", "hard", option, "3"], &[option, "hard"]);
    }
    refused(&["soak", "--scene", sheet, "--scene", "no-such-scene"], &["no-such-scene", "n-body"]);
    refused(&["soak", "--scene", sheet, "--per-loop", "101"], &["101", "2..=100"]);

    let frame = base.join("frame.png");
    for (more, words) in [
        (vec!["no-such-scene"], vec!["no-such-scene", "n-body"]),
        (vec![sheet, "--frame", "1000"], vec!["1000", "0 to"]),
        (vec![sheet, "--frames", "3..3"], vec!["empty"]),
        (vec![sheet, "--frames", "a..b"], vec!["0..50"]),
        (vec![sheet, "--frames", "0..2"], vec!["folder", ".gif"]),
        (vec![sheet, "--strategy", "hope"], vec!["hope", "refit+rotate"]),
        (vec![sheet, "--size", "0x10"], vec!["0x10", "1024x1024"]),
        (vec![sheet, "--threads", "0"], vec!["--threads"]),
        (vec![sheet, "--size", "-1x1"], vec!["-1", "--OPTION=VALUE"]),
        (vec![sheet, "--size=-1x1"], vec!["-1x1", "1024x1024"]),
        (vec![broken], vec!["broken.glb"]),
        (vec!["n-body", "--local-origin"], vec!["--local-origin", "n-body"]),
    ] {
        let mut all = vec!["render"];
        all.extend(more);
        all.extend(["--out", str(&frame)]);
        refused(&all, &words);
    }
    refused(&["render", sheet, "--out", str(&base.join("frame.bmp"))], &[".bmp", ".png"]);
    refused(&["render", sheet, "--out", str(&below_file)], &["below"]);
    if cfg!(target_os = "linux") {
        refused(&["render", sheet, "--out", "/proc/x.png"], &["/proc/x.png: cannot be written"]);
        refused(&["render", sheet, "--out", "/proc/"], &["/proc/sheet-0000.png"]);
    }
    let mut left: Vec<_> =
        fs::read_dir(base).expect("readable").map(|e| e.expect("readable").file_name()).collect();
    left.sort();
    assert_eq!(left, ["broken.glb", "file", "sheet"], "nothing is left under any name");
}

#[test]
fn help_and_version_are_no_errors() {
    assert!(succeeds(&["--help"]).contains("reproduce"));
    assert!(succeeds(&["reproduce", "--help"]).contains("--preset"));
    succeeds(&["--version"]);
    refused(&["list", "--nonsense"], &["--nonsense"]);
}

#[test]
fn list_names_what_there_is() {
    let table = succeeds(&["list"]);
    let json: serde_json::Value = serde_json::from_str(&succeeds(&["list", "--json"])).expect("JSON");
    let names = |key: &str| -> Vec<String> {
        let list = json[key].as_array().expect("a list");
        let name = |v: &serde_json::Value| v.as_str().or(v["name"].as_str()).expect("a name").to_owned();
        list.iter().map(name).collect()
    };
    for (key, some) in [
        ("scenes", &["n-body"][..]),
        ("strategies", &["refit", "refit+rotate", "sweep", "ideal", "ideal-parallel-binned"]),
        ("builders", &["sweep", "binned"]),
        ("simd_levels", &["baseline"]),
    ] {
        let names = names(key);
        assert!(some.iter().all(|s| names.iter().any(|n| n == s)), "{key}: {names:?}");
        assert!(names.iter().all(|n| table.contains(n.as_str())), "{key}");
    }
    assert!(json["scenes"][0]["triangles"].as_u64().expect("a number") > 0);
    for scene in json["scenes"].as_array().expect("a list") {
        assert!(scene["effects"].is_array() && scene["key_bytes"].is_u64());
        let plan = scene["plan"].as_array().expect("a list");
        assert!(plan.iter().any(|s| s == "update") && plan.iter().any(|s| s == "shadow"), "{plan:?}");
    }
}

#[test]
fn whole_frames_are_compared_of_those_asked_for_and_as_often_as_asked_for() {
    let (temporary, sheet) = folder();
    let json = temporary.path().join("frame.json");
    let compare = |more: &[&str]| {
        let sheet = ["compare", "frame", "--scene", str(&sheet), "--size", "24", "--threads", "1"];
        let mut all = sheet.to_vec();
        all.extend(["--only", "pivot auto", "--only", "refit+rotate+reinsert", "--json", str(&json)]);
        all.extend(more);
        let printed = succeeds(&all);
        let rows = fs::read(&json).expect("rows");
        let rows: serde_json::Value = serde_json::from_slice(&rows).expect("JSON");
        (printed, rows["rows"].as_array().expect("a list").clone())
    };
    let (printed, once) = compare(&[]);
    let (_, thrice) = compare(&["--runs", "3"]);
    let names: Vec<_> = once.iter().map(|row| row["contestant"].as_str().expect("a name")).collect();
    assert_eq!(names, ["pivot auto", "pivot refit+rotate+reinsert", "ray set-up"]);
    assert!(printed.contains("frame, pivot auto / pivot best of the rest, 1 thread"), "{printed}");
    let again = succeeds(&[
        "compare",
        "frame",
        "--from",
        str(&json),
        "--chart",
        str(&temporary.path().join("a.svg")),
    ]);
    assert!(again.contains("pivot auto / pivot best of the rest"), "{again}");
    assert!(fs::read_to_string(temporary.path().join("a.svg")).expect("a chart").contains("ray set-up"));
    let from = ["compare", "--from", str(&json), "--only"];
    let some = succeeds(&[&from[..], &["=pivot auto", "--only", "set-up"]].concat());
    assert!(some.contains("pivot auto") && some.contains("ray set-up"), "{some}");
    assert!(!some.contains("reinsert"), "{some}");
    refused(&[&from[..], &["=pivot"]].concat(), &["--only =pivot:", "pivot auto; pivot refit"]);
    let beside = succeeds(&[&from[..], &["pivot auto", "--beside", str(&json)]].concat());
    assert_eq!(beside.matches("1.00").count(), 1, "{beside}");
    for (once, thrice) in once.iter().zip(&thrice) {
        assert_eq!((&once["frames"], &once["agrees"]), (&thrice["frames"], &thrice["agrees"]));
        let count = |row: &serde_json::Value, of: &str| row[of].as_u64().expect("a number");
        for of in ["rays", "hits"] {
            assert_eq!(3 * count(once, of), count(thrice, of), "{of}");
        }
    }
}

#[test]
fn a_run_leaves_rows_figures_pictures_a_summary_and_a_report() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("results");
    let printed = succeeds(&[
        "reproduce",
        "--preset",
        "quick",
        "--scene",
        str(&sheet),
        "--frames",
        "5",
        "--loops",
        "1.4",
        "--size",
        "40",
        "--threads",
        "2",
        "--out",
        str(&out),
    ]);
    for line in ["hints, not results", "Rotations pay", "Use ", "0 differences", "report.html"] {
        assert!(printed.contains(line), "{printed}");
    }
    assert!(printed.lines().count() < 10, "{printed}");

    let rows = fs::read_to_string(out.join("frames.csv")).expect("rows");
    let header = rows.lines().next().expect("a header");
    assert!(header.starts_with(COLUMNS), "{header}");
    let width = header.split(',').count();
    assert!(rows.lines().all(|line| line.split(',').count() == width));
    let of = |strategy: &str| rows.lines().filter(|l| l.split(',').nth(1) == Some(strategy)).count();
    assert_eq!((of("refit"), of("refit+rotate")), (7, 7), "1.4 loops of 5 frames");
    assert_eq!(of("ideal"), of("sweep"));
    assert_eq!(of("ideal-parallel-binned"), of("binned"));
    assert!(of("binned-parallel") > 1);

    let summary = fs::read(out.join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_slice(&summary).expect("JSON");
    assert_eq!(summary["schema"], 3);
    assert_eq!(summary["interrupted"], false);
    assert_eq!(summary["checks"]["differences"], 0);
    for what in ["pictures", "pixels", "rays", "rays_hit", "trees"] {
        assert!(summary["checks"][what].as_u64().expect("a number") > 0, "{what}");
    }
    let scene = &summary["scenes"][0];
    assert_eq!(scene["triangles"], 512);
    let strategies = scene["strategies"].as_array().expect("a list");
    let cost = |name: &str| {
        let s = strategies.iter().find(|s| s["strategy"] == name).expect("measured");
        s["sah_cost"]["mean"].as_f64().expect("a number")
    };
    assert!(cost("refit+rotate") < cost("refit"), "rotations help on a sheet that folds");
    let rotations = strategies.iter().find(|s| s["strategy"] == "refit+rotate").expect("measured");
    assert!(rotations["rotations"].as_u64().expect("a number") > 0);

    let stages = rotations["stages"].as_array().expect("a list");
    let names: Vec<_> = stages.iter().map(|s| s["stage"].as_str().expect("a name")).collect();
    assert_eq!(names, ["key frames", "update", "primary", "shadow"]);
    // The first frame is at the time the sheet is at already, as is none of the six after it.
    assert_eq!(stages[0]["count"], 6 * 17 * 17);
    assert_eq!(stages[1]["count"], 7 * 512);
    let column = |name: &str| header.split(',').position(|c| c == name).expect("a column");
    let value = |line: &str, name: &str| line.split(',').nth(column(name)).expect("a value").to_owned();
    for (i, line) in rows.lines().skip(1).filter(|l| l.split(',').nth(1) == Some("refit")).enumerate() {
        assert_eq!(value(line, "vertices_blended"), if i == 0 { "0" } else { "289" });
        assert_eq!((value(line, "vertices_skinned"), value(line, "skin_ms")), ("0".into(), "0.0".into()));
        assert_eq!(value(line, "primitives_refit"), "512");
    }

    let report = fs::read_to_string(out.join("report.html")).expect("a report");
    assert!(report.contains("<svg") && report.contains("data:image/png;base64,"));
    for outside in ["src=\"http", "href=\"http", "url(", "@import"] {
        assert!(!report.contains(outside), "the report needs nothing from elsewhere: {outside}");
    }
    for figure in ["fig4.svg", "fig6-sheet.svg"] {
        let svg = fs::read_to_string(out.join("figures").join(figure)).expect(figure);
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>") && !svg.contains("NaN"), "{figure}");
    }
    let images = scene["images"].as_array().expect("a list");
    assert!(!images.is_empty());
    for image in images {
        let png =
            fs::read(out.join("images").join(image["file"].as_str().expect("a name"))).expect("a picture");
        let start: &[u8] = if image["strategy"].is_null() { b"\x89PNG" } else { b"\xff\xd8\xff" };
        assert!(png.starts_with(start), "{image}");
    }
    let partial = |e: fs::DirEntry| e.file_name().to_string_lossy().ends_with(".partial");
    assert!(!fs::read_dir(&out).expect("readable").any(|e| partial(e.expect("readable"))));
}

/// The experiments and strategies that a summary names.
fn ran(out: &Path) -> (Vec<String>, Vec<String>) {
    let summary = fs::read(out.join("summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_slice(&summary).expect("JSON");
    let names = |key: &str| -> Vec<String> {
        let list = summary["settings"][key].as_array().expect("a list");
        list.iter().map(|name| name.as_str().expect("a name").to_owned()).collect()
    };
    (names("experiments"), names("strategies"))
}

#[test]
fn only_what_is_asked_for_is_run() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("results");
    succeeds(&[
        "reproduce",
        "fig5",
        "--scene",
        str(&sheet),
        "--loops",
        "2",
        "--size",
        "8",
        "--out",
        str(&out),
    ]);
    let count = |name: &str| rows(&out.join(name)).len() - 1;
    assert_eq!((count("frames.csv"), ran(&out)), (0, (vec!["fig5".into()], vec!["refit+rotate".into()])));
    let report = fs::read_to_string(out.join("report.html")).expect("a report");
    assert!(
        report.contains("of each loop of figure 5 10 frames measured")
            && report.contains("\"speed_loops\":2.0")
    );
    assert_eq!(
        count("fig5.csv"),
        2 * 10 * (5 + 1 + 1),
        "ten frames of each loop, of the fastest with five strategies"
    );
    assert!(out.join("figures/fig5-sheet.svg").exists() && !out.join("figures/fig4.svg").exists());
}

#[test]
fn peers_stand_beside_the_project_and_are_drawn_again() {
    let (temporary, sheet) = folder();
    let (out, again) = (temporary.path().join("results"), temporary.path().join("again"));
    let [threads, size] = [["--threads", "2"], ["--size", "32"]];
    let run = ["reproduce", "peers", "--preset", "quick", "--scene", str(&sheet), "--out", str(&out)];
    succeeds(&[&run[..], &threads, &size].concat());
    let rows = fs::read_to_string(out.join("peers.csv")).expect("rows");
    let of = |what: &str, contestant: &str| {
        let start = format!("sheet/,{what},{contestant},2,2,");
        rows.lines().any(|line| line.starts_with(&start) && line.contains(",true,"))
    };
    let frames = fs::read_to_string(out.join("frames.csv")).expect("rows").lines().count() - 1;
    assert_eq!((frames, ran(&out)), (0, (vec!["peers".into()], vec![])), "no strategies but theirs");
    for contestant in ["pivot refit", "pivot refit+rotate", "obvhs refit"] {
        assert!(of("update", contestant), "{contestant}: {rows}");
    }
    assert!(of("frame", "pivot refit+rotate"), "{rows}");
    succeeds(&["reproduce", "--from", str(&out), "--out", str(&again)]);
    for folder in [&out, &again] {
        let report = fs::read_to_string(folder.join("report.html")).expect("a report");
        assert!(report.contains("obvhs refit"));
    }
    assert_eq!(fs::read_to_string(again.join("peers.csv")).expect("rows"), rows);
}

#[test]
fn accuracy_leaves_points_and_figures() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("results");
    let printed = succeeds(&[
        "reproduce",
        "accuracy",
        "--preset",
        "quick",
        "--scene",
        str(&sheet),
        "--frames",
        "4",
        "--size",
        "16",
        "--out",
        str(&out),
    ]);
    let points = fs::read_to_string(out.join("accuracy.csv")).expect("points");
    let header = "scene,knob,setting,is_default,error_name,error,unit,time_ms,note";
    assert!(points.starts_with(header), "{points}");
    for knob in [
        "update strategy",
        "builder",
        "triangle test at tiles",
        "guards against NaN at refit",
        "height bound",
    ] {
        let of_knob = || points.lines().filter(|line| line.starts_with(&format!("sheet/,{knob},")));
        let defaults = of_knob().filter(|line| line.split(',').nth(3) == Some("true")).count();
        assert!(of_knob().count() > 1 && defaults > 0, "{knob}: {points}");
    }
    let of_heights = || points.lines().filter(|line| line.contains(",height bound,"));
    assert!(of_heights().all(|line| line.contains("time of the plain update")), "{points}");
    // The sweep build is as good as itself.
    let errors = |start: &str| -> Vec<f64> {
        let lines = points.lines().filter(|line| line.contains(start));
        lines.map(|line| line.split(',').nth(5).and_then(|e| e.parse().ok()).expect("a number")).collect()
    };
    assert_eq!(errors(",builder,sweep,false,SAH cost"), [1.0]);
    assert_eq!(errors(",guards against NaN at refit,on,true,"), [0.0]);
    assert!(!points.contains("key frames"), "a model of one's own has none to choose");
    for advice in
        ["sheet/: strategy: ", "sheet/: builder and leaf size: ", "sheet/: triangle test: watertight"]
    {
        assert!(printed.contains(advice), "{printed}");
    }

    let svg = fs::read_to_string(out.join("figures/accuracy-update-strategy.svg")).expect("a figure");
    assert!(svg.starts_with("<svg") && svg.ends_with("</svg>") && !svg.contains("NaN"));
    let report = fs::read_to_string(out.join("report.html")).expect("a report");
    assert!(report.contains("What accuracy costs in time") && report.contains("Ringed: the default"));
    assert!(!out.join("figures/fig4.svg").exists());
}

#[test]
fn frames_are_rendered_to_png_and_exr() {
    let (temporary, sheet) = folder();
    let (png, exr, flat) =
        (temporary.path().join("a.png"), temporary.path().join("a.exr"), temporary.path().join("flat.png"));
    let render = |out: &Path, more: &[&str]| {
        let mut all = vec!["render", str(&sheet), "--frame", "2", "--size", "48x32", "--out", str(out)];
        all.extend(more);
        assert!(succeeds(&all).contains(out.file_name().and_then(|n| n.to_str()).expect("a name")));
        fs::read(out).expect("an image")
    };
    let smooth = render(&png, &[]);
    assert!(smooth.starts_with(b"\x89PNG"));
    assert!(render(&exr, &[]).starts_with(&[0x76, 0x2f, 0x31, 0x01]));
    assert_ne!(render(&flat, &["--flat"]), smooth);
    for strategy in ["refit", "sweep", "binned"] {
        assert_eq!(render(&png, &["--strategy", strategy, "--threads", "3"]), smooth, "{strategy}");
    }
    let film = temporary.path().join("film.gif");
    let toys = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/toys.glb");
    for (range, count) in [(&["--frames", "0..3"][..], 3), (&["--frame", "2"], 1), (&[], 49)] {
        succeeds(&[&["render", toys, "--size", "8x8", "--out", str(&film)], range].concat());
        let film = fs::read(&film).expect("a film");
        // Each frame begins with an extension that says how long it is shown.
        let frames = film.windows(3).filter(|bytes| bytes == b"\x21\xf9\x04").count();
        assert!(film.starts_with(b"GIF89a") && frames == count, "{frames} frames");
    }
    // The folder is made.
    let below = temporary.path().join("new/frame.png");
    succeeds(&["render", toys, "--frame", "0", "--size", "8x8", "--out", str(&below)]);
    assert!(below.exists());
    let range = temporary.path().join("range");
    succeeds(&["render", str(&sheet), "--frames", "1..3", "--size", "8x8", "--out", str(&range)]);
    let mut names: Vec<_> =
        fs::read_dir(&range).expect("readable").map(|e| e.expect("readable").file_name()).collect();
    names.sort();
    assert_eq!(names, ["sheet-0001.png", "sheet-0002.png"]);
}

#[test]
fn render_says_what_runs_and_why_and_keeps_details_far_from_the_origin() {
    let temporary = tempfile::TempDir::new().expect("a temporary folder");
    let render = |model: &Path, more: &[&str]| {
        let out = temporary.path().join("picture.png");
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_xtask"));
        let output = command.arg("render").arg(model).args(["--size", "32x32", "--out"]).arg(&out).args(more);
        let output = output.output().expect("it starts");
        assert!(output.status.success(), "{output:?}");
        (String::from_utf8(output.stderr).expect("UTF-8"), fs::read(&out).expect("a picture"))
    };
    let toys = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/toys.glb"));
    let (said, _) = render(toys, &[]);
    for line in
        ["a frame runs ", "  skin: 1 of 5 parts have joints that move", "  shadow: the file has a light"]
    {
        assert!(said.contains(line), "{line}: {said}");
    }
    assert!(!render(toys, &["--effects", "none"]).0.contains("shadow:"));

    // A roof of an eighth of a metre, whose coordinates have all their bits as text only.
    let roof = |name: &str, at: f64| {
        let corners = [[0.0, 0.0, 0.0], [0.125, 0.0, 0.0], [0.0, 0.125, 0.0625], [0.125, 0.125, 0.0]];
        let lines = corners.map(|c| format!("v {} {} {}\n", at + c[0], at + c[1], at + c[2]));
        let path = temporary.path().join(name);
        fs::write(&path, lines.concat() + "f 1 2 3\nf 2 4 3\n").expect("a file");
        path
    };
    let [near, far] = [("near.obj", 0.0), ("far.obj", 6_378_137.0)].map(|(name, at)| roof(name, at));
    let picture = render(&near, &["--local-origin"]).1;
    assert!(render(&far, &["--local-origin"]).1 == picture);
    assert!(render(&far, &[]).1 != picture, "without it they are lost");
}

#[test]
fn a_model_without_its_textures_keeps_its_plain_colours() {
    let temporary = tempfile::TempDir::new().expect("a temporary folder");
    let gltf = temporary.path().join("bare.gltf");
    let positions: Vec<u8> =
        [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    fs::write(temporary.path().join("bare.bin"), positions).expect("a file");
    let json = r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"bare.bin","byteLength":36}],
        "bufferViews":[{"buffer":0,"byteLength":36}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
        "images":[{"uri":"gone.png"}],"textures":[{"source":0}],
        "materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0}]}],"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}]}"#;
    fs::write(&gltf, json).expect("a file");
    let render = |more: &[&str]| {
        let out = temporary.path().join("bare.png");
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_xtask"));
        let output =
            command.args(["render", str(&gltf), "--size", "8x8", "--out", str(&out)]).args(more).output();
        let output = output.expect("it starts");
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stderr).expect("UTF-8")
    };
    assert_eq!(render(&[]).matches("gone.png").count(), 1, "one line of warning");
    assert!(
        !render(&["--effects", "shadows"]).contains("gone.png"),
        "no texture is asked for, so none is read"
    );
}

#[test]
fn two_runs_into_one_folder_are_refused() {
    let (temporary, sheet) = folder();
    let out = temporary.path().join("results");
    fs::create_dir(&out).expect("a folder");
    let lock = fs::File::create(out.join(".pivot-lock")).expect("a file");
    lock.try_lock().expect("nobody else has it");
    refused(&["reproduce", "--scene", str(&sheet), "--out", str(&out)], &["another run", "--out"]);
}

#[test]
fn control_characters_are_not_printed() {
    let output =
        std::process::Command::new(env!("CARGO_BIN_EXE_xtask")).args(["render", "x\u{1b}[31m.glb"]).output();
    let message = String::from_utf8(output.expect("it starts").stderr).expect("UTF-8");
    assert!(message.contains("[31m.glb") && !message.contains('\u{1b}'), "{message:?}");
}
