//! `foveate mock` and `foveate demo`.

use super::*;

const MOCK: &str = "mock scene.glb --json --width 96 --height 32 --samples 200 --rays 2 \
                    --position 0.2,1,2.5 --look-at 0,0.8,0";

/// The lines of `frames.jsonl`.
fn frames(folder: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(folder.join("frames.jsonl")).unwrap();
    assert!(text.is_empty() || text.ends_with('\n'));
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Two entries of one driver, and parts of unequal size, which PoCL makes of a processor of any size.
#[test]
fn pictures_do_not_depend_on_how_a_processor_is_offered() {
    let folder = folder();
    let list = foveate(folder.path(), "devices --json").succeeds().json();
    let pocl = |d: &Value| d["platform"] == "Portable Computing Language" && d["kind"] == "cpu";
    if !list["opencl"].as_array().is_some_and(|all| all.len() == 1 && pocl(&all[0])) {
        println!("not run: PoCL is not the only OpenCL driver here");
        return;
    }
    let shared = |out: &str, name: &str, value: &str, options: &str| {
        // Enough samples for a part of some for the slower one, too.
        let mock = MOCK.replace("--samples 200", "--samples 1400");
        let mut offered = command(folder.path(), &format!("{mock} --frames 6 --out {out} {options}"));
        offered.env(name, value);
        run(offered).succeeds();
        frames(&folder.path().join(out))
    };
    shared("alone", "POCL_DEVICES", "cpu", "--devices 0");
    for (name, value, options) in [
        ("POCL_DEVICES", "cpu cpu", "--devices 0,1"),
        ("POCL_CPU_MAX_CU_COUNT", "4", "--set devices.subdivide=[1,3]"),
    ] {
        let lines = shared("shared", name, value, options);
        assert_eq!(lines.len(), 6);
        // A device that happened to be slow in one frame may have nothing to do in the next.
        let works = |device: &Value| device["samples"].as_u64() > Some(0);
        let both = |line: &Value| {
            let devices = line["devices"].as_array().unwrap();
            assert_eq!(devices.len(), 2, "{line}");
            devices.iter().all(works)
        };
        assert!(lines.iter().any(both), "{lines:?}");
        for index in 0..6 {
            let picture = format!("frame_{index:04}.png");
            let read = |out: &str| std::fs::read(folder.path().join(out).join(&picture)).unwrap();
            assert!(read("alone") == read("shared"), "{picture} with {name}={value}");
        }
    }
}

/// Pictures are the same; several devices are timed all the same, since they are balanced by it.
#[test]
fn a_device_that_traces_alone_need_not_be_timed() {
    let folder = folder();
    let list = foveate(folder.path(), "devices --json").succeeds().json();
    let timed = |out: &str, options: &str| {
        let told =
            foveate(folder.path(), &format!("{MOCK} --frames 3 --out {out} {options}")).succeeds().json();
        let lines = frames(&folder.path().join(out));
        let keys = ["trace_ms", "shade_ms"];
        let of_line = |line: &Value| keys.map(|key| line[key].as_f64().unwrap() > 0.0);
        let times: Vec<bool> = lines.iter().flat_map(of_line).collect();
        (times, told["mrays_per_second"].as_f64().unwrap() > 0.0)
    };
    assert_eq!(timed("timed", "--devices 0"), (vec![true; 6], true));
    assert_eq!(timed("untimed", "--devices 0 --set devices.profile=false"), (vec![false; 6], false));
    for index in 0..3 {
        let read =
            |out: &str| std::fs::read(folder.path().join(format!("{out}/frame_{index:04}.png"))).unwrap();
        assert!(read("timed") == read("untimed"), "picture {index}");
    }
    if list["opencl"][0]["kind"] != "cpu" || list["opencl"][0]["compute_units"].as_u64() < Some(2) {
        println!("not run: the first device cannot be divided");
        return;
    }
    let parts = "--devices 0 --set devices.subdivide=[1,1] --set devices.profile=false";
    assert_eq!(timed("parts", parts), (vec![true; 6], true));
}

#[test]
fn a_run_writes_pictures_sheet_preview_and_a_line_for_each_frame() {
    let folder = folder();
    let out = folder.path().join("frames");
    std::fs::create_dir(&out).unwrap();
    for name in ["notes.txt", "frame_0009.png", "frame_0000.png"] {
        std::fs::write(out.join(name), "of an earlier run").unwrap();
    }
    let told = foveate(folder.path(), &format!("{MOCK} --frames 4 --out frames")).succeeds().json();
    assert_eq!([&told["width"], &told["height"], &told["pixels"]], [96, 32, 3072]);
    assert_eq!([&told["samples"], &told["frames"]], [400, 4], "both eyes' samples");
    for key in ["fps", "rays", "frame_ms", "stage_ms", "device", "sharing", "presenter"] {
        assert!(!told[key].is_null(), "{key} of {told}");
    }
    let lines = frames(&out);
    assert_eq!(lines.len(), 4);
    for (index, line) in lines.iter().enumerate() {
        assert_eq!(
            [&line["frame"], &line["samples"], &line["pixels"]],
            [index, 400, 3072].map(Value::from).each_ref()
        );
        assert!(line["rays"].as_u64().unwrap() > 400);
        for key in ["pattern_ms", "trace_ms", "shade_ms", "share_ms", "reconstruct_ms", "frame_ms"] {
            assert!(line[key].as_f64().unwrap() >= 0.0, "{key} of {line}");
        }
        assert_eq!(png(out.join(format!("frame_{index:04}.png"))).dimensions(), (96, 32));
    }
    assert!(lines.windows(2).all(
        |pair| pair[0]["gaze"] != pair[1]["gaze"] || pair[0]["head_position"] != pair[1]["head_position"]
    ));
    assert!(png(out.join("contact_sheet.png")).width() > 96);
    assert!(std::fs::read(out.join("preview.gif")).unwrap().starts_with(b"GIF89a"));
    // What other runs left is kept, apart from files of the same names; nothing else appears.
    assert_eq!(std::fs::read(out.join("notes.txt")).unwrap(), b"of an earlier run");
    assert_eq!(std::fs::read(out.join("frame_0009.png")).unwrap(), b"of an earlier run");
    let expected = [
        "contact_sheet.png",
        "frame_0000.png",
        "frame_0001.png",
        "frame_0002.png",
        "frame_0003.png",
        "frame_0009.png",
        "frames.jsonl",
        "notes.txt",
        "preview.gif",
    ];
    assert_eq!(names(&out), expected);
}

#[test]
fn rendering_flags_hold_for_the_mock_headset() {
    let folder = folder();
    let first = |flags: &str| {
        let told = foveate(folder.path(), &format!("{MOCK} --frames 1 --out f {flags}")).succeeds().json();
        (png(folder.path().join("f/frame_0000.png")), told, frames(&folder.path().join("f")))
    };
    let (base, told, _) = first("");
    assert_eq!(told["presenter"], "mock headset (generic)");
    assert_eq!(differing(&base, &first("").0), 0, "the same again");
    for flags in [
        "--headset dk1",
        "--fov-y 40",
        "--gaze 0,1 --reconstruct k-nn",
        "--seed 3",
        "--exposure 1",
        "--stereo shared",
        "--set view.ipd=0.5",
        "--look-at 9,0,0",
        "--law uniform",
    ] {
        let changed = differing(&base, &first(flags).0);
        assert!(changed > 100, "{flags} changes {changed} pixels");
    }
    // Both hands are held below the horizon.
    let [held, bare] = ["--hands", "--hands=bare"].map(|flags| first(flags).0);
    assert!(differing(&base, &held) > 20 && differing(&base, &bare) > 20 && differing(&held, &bare) > 20);
    let (mono, told, _) = first("--stereo mono --samples 900");
    assert_eq!((mono.dimensions(), &told["samples"]), ((96, 32), &json!(900)));
    assert_eq!(first("--gaze 0.25,0.75").2[0]["gaze"], json!([0.25, 0.75]));
    let run = foveate(folder.path(), &format!("{MOCK} --out f --headset rift9"));
    assert!(run.sentence().contains("choose dk1 or generic"), "{run:?}");
    let run = foveate(folder.path(), &format!("{MOCK} --out f --width 97"));
    assert!(run.sentence().contains("--width: both eyes share it"), "{run:?}");
}

#[test]
fn a_name_that_is_taken_by_a_folder_is_told_before_the_scene_is_read() {
    let folder = folder();
    for name in ["frames.jsonl", "contact_sheet.png", "preview.gif"] {
        let taken = folder.path().join("out").join(name);
        std::fs::create_dir_all(&taken).unwrap();
        let run = foveate(folder.path(), "mock none.glb --out out");
        assert!(run.sentence().contains(&format!("{name}: a folder is in its place")), "{run:?}");
        std::fs::remove_dir(taken).unwrap();
    }
}

/// Ends a run in its middle, as Ctrl-C does, and looks at what it left.
#[cfg(unix)]
#[test]
fn an_interrupted_run_leaves_whole_files() {
    let folder = folder();
    let out = folder.path().join("out");
    let mut child =
        command(folder.path(), "mock scene.glb --width 640 --height 320 --frames 100000 --out out")
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap();
    while !out.join("frame_0002.png").exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    assert!(!child.wait().unwrap().success());
    let pictures: Vec<String> = names(&out).into_iter().filter(|name| name.ends_with(".png")).collect();
    assert!(pictures.len() >= 3);
    for name in &pictures {
        assert_eq!(png(out.join(name)).dimensions(), (640, 320), "{name}");
    }
    assert!(frames(&out).len() >= pictures.len());
}

#[test]
fn the_demo_writes_all_its_files_and_tells_what_it_did() {
    let folder = tempfile::tempdir().unwrap();
    let small = "--set view.width=256 --set view.height=160 --set foveation.samples=2000 --set trace.rays=4";
    let run = foveate(folder.path(), &format!("demo {small}")).succeeds();
    let pixels = 256 * 160;
    for part in [
        "fps",
        &format!("4000 shaded samples for {pixels} pixels"),
        "Mrays/s",
        "traced by",
        "mock headset",
        "out/demo",
    ] {
        assert!(run.out.contains(part), "{part}: {run:?}");
    }
    let out = folder.path().join("out/demo");
    let lines = frames(&out);
    assert!(lines.len() >= 2);
    assert_eq!(names(&out).len(), lines.len() + 3);
    let picture = png(out.join("frame_0000.png"));
    assert_eq!(picture.dimensions(), (256, 160));
    let colours: std::collections::HashSet<_> = picture.pixels().map(|pixel| pixel.0).collect();
    assert!(colours.len() > 1000, "{} colours: it shows something", colours.len());
}

#[test]
fn a_demo_without_a_display_has_none_to_keep_up_with() {
    let folder = tempfile::tempdir().unwrap();
    let run = foveate(folder.path(), "demo --set view.width=64 --set view.height=32").succeeds();
    let lines = frames(&folder.path().join("out/demo"));
    assert!(lines.len() >= 2 && lines.iter().all(|line| line["budget"].is_null()), "{run:?}");
    assert!(!run.err.contains("however long"), "{run:?}");
}

#[test]
fn a_frame_time_is_held_along_the_front_and_the_log_tells_how() {
    let folder = folder();
    let mock =
        |flags: &str| foveate(folder.path(), &format!("{MOCK} --frames 12 --gaze 0.5,0.5 --out f {flags}"));
    let run = |flags: &str| {
        mock(flags).succeeds();
        frames(&folder.path().join("f"))
    };
    assert!(run("").iter().all(|line| line["budget"].is_null()), "nothing is held unless it is asked for");
    // No machine makes a frame in 0.1 ms, and every machine makes such small ones within a minute.
    let out_of_reach = mock("--target-ms 0.1");
    assert_eq!((out_of_reach.code, out_of_reach.err.lines().count()), (Some(0), 1), "{out_of_reach:?}");
    assert!(out_of_reach.err.contains("the target of 0.1 ms is out of reach"), "{out_of_reach:?}");
    let hurried = frames(&folder.path().join("f"));
    let patient = run("--target-ms 60000");
    let missed = |lines: &[Value]| lines.iter().filter(|l| l["budget"]["time_out_of_reach"] == true).count();
    assert_eq!((missed(&patient), hurried[11]["budget"]["time_out_of_reach"].as_bool()), (0, Some(true)));
    assert!((1..12).contains(&missed(&hurried)), "known after a few frames: {}", missed(&hurried));
    let told = mock("--target-ms 0.1 --json");
    assert_eq!(told.code, Some(0), "{told:?}");
    let budget = &told.json()["budget"];
    assert_eq!([&budget["time_out_of_reach"], &budget["frames_over"]], [&json!(true), &json!(12)]);
    let last = |lines: &[Value], key: &str| lines[11]["budget"][key].as_f64().unwrap();
    assert_eq!((last(&hurried, "position"), last(&patient, "position")), (0.0, 1.0));
    assert_eq!(last(&hurried, "target_ms"), 0.1);
    assert!(hurried[11]["rays"].as_u64() < patient[11]["rays"].as_u64());
    assert!(last(&hurried, "score") < last(&patient, "score"));
    assert_eq!(mock("--target-ms display --headset dk1").code, Some(0));
    let display = frames(&folder.path().join("f"));
    assert!((last(&display, "target_ms") - 15.0).abs() < 1e-6, "{}", last(&display, "target_ms"));
    // A score that no point has is told at once, and the best is done.
    let unreached = mock("--target-ms none --target-score 9.99");
    assert!(unreached.err.contains("the target score of 9.99 is out of reach"), "{unreached:?}");
    let lines = frames(&folder.path().join("f"));
    assert!(
        lines.iter().all(|l| l["budget"]["score_out_of_reach"] == true && l["budget"]["position"] == 1.0)
    );
    // Settings that are not on the front are not silently others.
    let foreign = mock("--target-ms 60000 --bounces 2");
    assert!(foreign.err.contains("the front has no points with these settings"), "{foreign:?}");
    let scored = run("--target-ms none --target-score 0.1 --preset accurate");
    assert_eq!((last(&scored, "position"), &scored[11]["budget"]["target_ms"]), (0.0, &Value::Null));
    let run = foveate(folder.path(), &format!("{MOCK} --out f --target-ms 0"));
    assert!(run.sentence().contains("--target-ms: 0 is out of range"), "{run:?}");
    let run = foveate(folder.path(), &format!("{MOCK} --out f --target-ms soon"));
    assert!(run.sentence().contains("--target-ms: give milliseconds"), "{run:?}");
    let run = foveate(folder.path(), &format!("{MOCK} --out f --target-score 11"));
    assert!(run.sentence().contains("--target-score: 11 is out of range"), "{run:?}");
}

#[test]
fn presets_are_known_by_name() {
    let folder = folder();
    let samples = |flags: &str| {
        let size = "--width 200 --height 100";
        let flags = format!("render scene.glb --out a.png --json {size} {flags}");
        let told = foveate(folder.path(), &flags).succeeds().json();
        (told["samples"].as_u64().unwrap(), told["rays"].as_u64().unwrap())
    };
    let (fast, accurate) = (samples("--preset fast"), samples("--preset accurate"));
    assert!(fast.1 < accurate.1, "{fast:?} {accurate:?}");
    assert_eq!(samples("--preset fast --samples 0.5").0, 10_000, "flags win");
    let run = foveate(folder.path(), "render scene.glb --out a.png --preset best");
    assert!(run.sentence().contains("choose one of fast, balanced, accurate"), "{run:?}");
}

#[test]
fn frames_of_an_earlier_run_are_not_left_among_new_ones() {
    let folder = folder();
    let run = |frames: u32| {
        let small = "--width 64 --height 24 --rays 1";
        foveate(folder.path(), &format!("mock scene.glb --out it --frames {frames} {small}")).succeeds();
        names(&folder.path().join("it"))
    };
    assert_eq!(run(3).iter().filter(|name| name.starts_with("frame_")).count(), 3);
    std::fs::write(folder.path().join("it/frame_of_mine.png"), "kept").unwrap();
    let left = run(1);
    let numbered = |name: &&String| name.starts_with("frame_0");
    assert_eq!(left.iter().filter(numbered).count(), 1, "{left:?}");
    assert!(left.contains(&"frame_of_mine.png".to_string()), "{left:?}");
    // Where no run of this program has been, pictures are somebody else's.
    std::fs::create_dir(folder.path().join("other")).unwrap();
    std::fs::write(folder.path().join("other/frame_0007.png"), "kept").unwrap();
    foveate(folder.path(), "mock scene.glb --out other --frames 1 --width 64 --height 24 --rays 1")
        .succeeds();
    assert_eq!(std::fs::read(folder.path().join("other/frame_0007.png")).unwrap(), b"kept");
}

#[test]
fn small_pictures_have_a_share_of_their_pixels_as_samples() {
    let folder = folder();
    let told = foveate(folder.path(), "mock scene.glb --out it --frames 1 --width 320 --height 100 --json");
    let told = told.succeeds().json();
    assert_eq!((&told["pixels"], &told["samples"]), (&json!(32_000), &json!(2 * 864)), "{told}");
    let told = foveate(folder.path(), "demo scene.glb --out shown --width 64 --height 24 --json");
    let told = told.succeeds().json();
    assert_eq!((&told["width"], &told["height"]), (&json!(64), &json!(24)), "{told}");
}
