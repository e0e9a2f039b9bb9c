//! What cannot be done is refused in one sentence, and nothing is lost.

use super::*;

#[test]
fn settings_that_do_not_fit_are_refused_by_the_name_they_were_given() {
    let folder = folder();
    std::fs::write(folder.path().join("bad.toml"), "[trace]\nrays = 'many'").unwrap();
    std::fs::write(folder.path().join("no.toml"), "trace = {").unwrap();
    let view = "render scene.glb --out it.png --width 48 --height 32";
    for (flags, part) in [
        ("--samples 1537", "--samples: 1537 are more than the 1536 pixels"),
        ("--samples 800 --stereo per-eye", "--samples: 800 are more than the 768 pixels of each eye"),
        ("--samples 0", "--samples: "),
        ("--samples 99999999999999999999", "--samples: "),
        ("--samples some", "--samples: "),
        ("--set foveation.samples=1537", "foveation.samples: 1537"),
        ("--rays 0", "--rays: 0 is out of range"),
        ("--rays 5000", "--rays: 5000 is out of range"),
        ("--bounces 5", "--bounces: 5 is out of range; give 0 to 4"),
        ("--k 0", "--k: 0 is out of range; give 1 to 16"),
        ("--k 17", "--k: 17"),
        ("--fov-y 0.5", "--fov-y: 0.5 is out of range; give 1 to 175"),
        ("--fov-y 175.5", "--fov-y: 175.5"),
        ("--fov-y nan", "--fov-y: NaN"),
        ("--exposure inf", "--exposure: inf"),
        ("--width 0", "--width: 0"),
        ("--width 16385", "--width: 16385"),
        ("--width 16384 --height 16384", "--width: 16384x16384 are more than"),
        ("--width 47 --stereo shared", "--width: both eyes share it"),
        ("--law spiral", "--law: "),
        ("--law Full", "--law: "),
        ("--environment none.hdr", "none.hdr: there is no such file"),
        ("--environment scene.glb", "scene.glb: its name ends neither in .hdr nor in .exr"),
        ("--device voodoo2", "none is called \"voodoo2\"; `foveate devices` lists them"),
        ("--set devices.vulkan=voodoo2", "voodoo2"),
        ("--devices 99", "none is called \"99\""),
        ("--set trace.rays=many", "expected a whole number"),
        ("--set trace.hardware_rays=yes", "expected one of `off`, `on`, `auto`"),
        (
            "--set trace.hardware_rays=on --set trace.traversal=packet",
            "trace.hardware_rays: packets of rays are traced by kernels alone",
        ),
        ("--set trace.rayz=3", "rayz"),
        ("--set trace.rays", "not key=value"),
        ("--set foveation.law.exponent=2", "exponent: 2 is out of range"),
        ("--config none.toml", "none.toml: there is no such file"),
        ("--config bad.toml", "bad.toml: trace.rays: "),
        ("--config no.toml", "no.toml: it is not a TOML file"),
        ("--config .", ".: it is not a regular file"),
        ("--position 1,1,1 --look-at 1,1,1", "--look-at: it is where the eye is"),
    ] {
        let run = foveate(folder.path(), &format!("{view} {flags}"));
        assert!(run.sentence().contains(part), "{flags}: {run:?}");
        let run = foveate(folder.path(), &format!("{view} {flags} --json"));
        assert!(run.refusal().1.contains(part), "{flags}: {run:?}");
    }
    assert!(!folder.path().join("it.png").exists());
}

/// Whatever a key is given, what is said is in words of TOML and not of Rust.
#[test]
fn values_of_wrong_kinds_are_refused_in_plain_words() {
    fn keys(table: &toml::Table, above: &str, found: &mut Vec<String>) {
        for (key, value) in table {
            let key = if above.is_empty() { key.clone() } else { format!("{above}.{key}") };
            if let Some(table) = value.as_table() {
                keys(table, &key, found);
            }
            found.push(key);
        }
    }
    const RUST: [&str; 13] = [
        "enum", "struct", "u32", "u64", "usize", "f32", "f64", "unit", "sequence", "map,", "floating",
        "string", "boolean",
    ];
    let defaults =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/configs/default.toml")).unwrap();
    let mut all = Vec::new();
    keys(&defaults.parse().unwrap(), "", &mut all);
    let mut refused = 0;
    for key in &all {
        for value in
            ["3", "-1", "1.5", "true", "\"abc\"", "[1]", "[[1]]", "[{}]", "{}", "{ a = 1 }", "1979-05-27"]
        {
            let mut layers = foveate::config::Layers::default();
            let line = format!("{key}={value}");
            let Err(error) = layers.assign(&line).and_then(|()| layers.finish().map(drop)) else { continue };
            refused += 1;
            let told = error.to_string();
            let mut words = told.split(|c: char| c.is_whitespace() || c == ';' || c == '`');
            assert!(!words.any(|word| RUST.contains(&word)), "{line}: {told}");
        }
    }
    assert!(all.len() > 50 && refused > 4 * all.len(), "{refused} of {} keys", all.len());
}

#[test]
fn wrong_usage_exits_with_2_and_shows_the_way() {
    let folder = folder();
    for arguments in [
        "",
        "paint",
        "render",
        "render scene.glb",
        "render --out it.png",
        "render scene.glb --out",
        "render scene.glb --out it.png --widht 3",
        "render scene.glb --out it.png --width many",
        "render scene.glb --out it.png --width -3",
        "render scene.glb --out it.png --seed 4294967296",
        "render scene.glb --out it.png --stereo both",
        "render scene.glb --out it.png --reconstruct magic",
        "render scene.glb --out it.png --passes 0",
        "render scene.glb --out it.png --gaze 0.5",
        "render scene.glb --out it.png --gaze nan,0.5",
        "render scene.glb --out it.png --gaze 0.5,inf",
        "render scene.glb --out it.png --position 1,2",
        "render scene.glb --out it.png --look-at 1,2,x",
        "render scene.glb other.glb --out it.png",
        "mock scene.glb --out frames --frames 0",
        "scene",
        "scene generate mountain --out it.glb",
        "tracker --replay a --record b",
    ] {
        let run = foveate(folder.path(), arguments);
        assert_eq!((run.code, run.out.as_str()), (Some(2), ""), "{arguments}: {run:?}");
        assert!(run.err.contains("--help") || run.err.contains("Usage:"), "{arguments}: {run:?}");
    }
    assert_eq!(names(folder.path()), ["scene.glb"]);
}

/// What chooses in a file means nothing for the demo scene.
#[test]
fn the_demo_scene_has_nothing_to_choose() {
    let folder = folder();
    for flag in ["--camera 1", "--scene a", "--variant 0", "--scale 2"] {
        let run = foveate(folder.path(), &format!("demo --out it {flag}"));
        let name = flag.split(' ').next().unwrap();
        assert!(run.sentence().contains(&format!("{name}: it chooses in a file")), "{flag}: {run:?}");
    }
    assert_eq!(names(folder.path()), ["scene.glb"]);
}

#[test]
fn help_tells_of_every_command_and_the_version() {
    let here = Path::new(".");
    for command in
        ["", "render", "mock", "demo", "scene", "scene info", "scene generate", "tracker", "devices"]
    {
        let run = foveate(here, &format!("{command} --help")).succeeds();
        assert!(run.out.contains("Usage: foveate"), "{run:?}");
        let flags: &[&str] = match command {
            "" | "scene" => &[],
            "scene generate" => &["--json"],
            _ => &["--json", "--config", "--set"],
        };
        assert!(flags.iter().all(|flag| run.out.contains(flag)), "{run:?}");
    }
    assert!(foveate(here, "--version").succeeds().out.contains(env!("CARGO_PKG_VERSION")));
}

#[test]
fn places_that_cannot_be_written_are_told_before_the_scene_is_read() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("dir.png")).unwrap();
    std::fs::write(folder.path().join("file"), "kept").unwrap();
    for (out, part) in [
        ("none/it.png", "none/it.png: its folder does not exist"),
        ("dir.png", "dir.png: a folder is in its place"),
        ("file/it.exr", "file/it.exr: a part of this path is a file"),
        ("it.jpg", "--out: it.jpg ends in neither .png nor .exr"),
        ("it", "--out: it ends in neither .png nor .exr"),
    ] {
        // There is no such scene: that it is not missed shows what is looked at first.
        let run = foveate(folder.path(), &format!("render none.glb --out {out}"));
        assert!(run.sentence().contains(part), "{out}: {run:?}");
    }
    for arguments in ["mock none.glb --out file", "mock none.glb --out file/deep", "demo --out file"] {
        let run = foveate(folder.path(), arguments);
        assert!(run.sentence().contains("is a file, not a folder"), "{run:?}");
    }
    let run = foveate(folder.path(), "scene generate voxel-town --triangles 12000 --out none/town.glb");
    assert!(run.sentence().contains("its folder does not exist"), "{run:?}");
    assert_eq!(names(folder.path()), ["dir.png", "file", "scene.glb"]);
    assert_eq!(std::fs::read(folder.path().join("file")).unwrap(), b"kept");
}

#[test]
fn scenes_that_cannot_be_used_are_told_and_what_was_there_stays() {
    let folder = folder();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("empty.gltf", br#"{"asset":{"version":"2.0"}}"#);
    write("nothing.glb", b"");
    write("old.png", b"\x89PNG, a picture of an earlier day");
    std::fs::create_dir(folder.path().join("dir.gltf")).unwrap();
    for (scene, part) in [
        ("none.glb", "none.glb: there is no such file"),
        ("dir.gltf", "dir.gltf: it is not a regular file"),
        ("empty.gltf", "it has no triangles to show"),
        ("nothing.glb", "nothing.glb: "),
        ("old.png", "old.png: "),
    ] {
        for command in ["render", "mock --frames 1"] {
            let out = if command == "render" { "old.png" } else { "frames" };
            let run = foveate(folder.path(), &format!("{command} {scene} --out {out}"));
            assert!(run.sentence().contains(part), "{run:?}");
        }
    }
    assert_eq!(
        std::fs::read(folder.path().join("old.png")).unwrap(),
        b"\x89PNG, a picture of an earlier day"
    );
    assert!(!folder.path().join("frames").exists());
    let info = foveate(folder.path(), "scene info empty.gltf --json").succeeds().json();
    assert_eq!((&info["triangles"], info["bounds"].is_null()), (&json!(0), true));
}

/// All files below a folder, in a fixed order.
fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() { files(&path, found) } else { found.push(path) }
    }
}

#[test]
fn malformed_and_unsupported_files_make_a_picture_or_one_sentence() {
    let mut scenes = Vec::new();
    if let Some(corpus) = common::data("bad_gltf/data") {
        files(&corpus, &mut scenes);
        scenes.retain(|path| path.extension().is_some_and(|e| e == "gltf" || e == "glb"));
        scenes = scenes.into_iter().step_by(20).collect();
    }
    for name in ["Duck.gltf", "Box.gltf", "BoxTextured_meshopt.glb"] {
        scenes.extend(common::data(&format!("scenes/unsupported/{name}")));
    }
    let folder = tempfile::tempdir().unwrap();
    let mut refused = 0;
    for scene in &scenes {
        let mut command = command(folder.path(), "render --out it.png --width 16 --height 16 --rays 1");
        let run = run({
            command.arg(scene);
            command
        });
        match run.code {
            // Warnings are allowed where a picture is made all the same.
            Some(0) => assert!(run.err.lines().all(|line| line.starts_with("foveate: note: ")), "{run:?}"),
            _ => {
                let name = scene.file_name().unwrap().to_str().unwrap();
                assert!(run.sentence().contains(name), "{run:?}");
                refused += 1;
            }
        }
    }
    assert!(scenes.is_empty() || refused > 5, "{refused} of {} are refused", scenes.len());
}

/// A diary under the name of an output stays a diary, whatever the command.
#[test]
fn files_of_another_kind_are_not_overwritten() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("used")).unwrap();
    let small = "--width 32 --height 20 --rays 1";
    for (file, arguments) in [
        ("it.png", format!("render scene.glb --out it.png {small}")),
        ("it.exr", format!("render scene.glb --out it.exr {small}")),
        ("it.glb", "scene generate demo --out it.glb".to_string()),
        ("it.rec", "tracker --record it.rec --seconds 1".to_string()),
        ("rays.bin", "bench scene.glb --export rays.bin --width 32 --height 20".to_string()),
        ("used/contact_sheet.png", format!("mock scene.glb --out used --frames 1 {small}")),
        ("used/preview.gif", format!("demo scene.glb --out used {small}")),
        ("used/frames.jsonl", format!("mock scene.glb --out used --frames 1 {small}")),
        ("head.log", "run scene.glb --log head.log".to_string()),
        ("used/front.toml", format!("measure scene.glb --quick --out used {small}")),
        ("used/report.json", format!("measure scene.glb --quick --out used {small}")),
        ("town.obj", "scene generate voxel-town --triangles 12000 --out town.obj".to_string()),
        ("town.mtl", "scene generate voxel-town --triangles 12000 --out town.obj".to_string()),
    ] {
        std::fs::write(path(file), "a diary").unwrap();
        let run = foveate(folder.path(), &arguments);
        assert!(run.sentence().contains("is there already and is no"), "{run:?}");
        assert_eq!(std::fs::read(path(file)).unwrap(), b"a diary", "{arguments}");
        std::fs::remove_file(path(file)).unwrap();
    }
    assert!(names(&path("used")).is_empty());
}

#[test]
fn a_tracker_that_is_not_there_leaves_the_recording_of_before() {
    let folder = folder();
    let path = folder.path().join("head.rec");
    let before = [b"foveate dk1 1.0\n".to_vec(), vec![0; 70]].concat();
    std::fs::write(&path, &before).unwrap();
    let run = foveate(folder.path(), "tracker --record head.rec --seconds 1");
    // With a tracker there would be a new recording, and that is right.
    if run.code != Some(0) {
        assert!(std::fs::read(&path).unwrap() == before, "{run:?}");
    }
    assert_eq!(names(folder.path()), ["head.rec", "scene.glb"]);
}

#[test]
fn what_is_no_recording_is_not_replayed() {
    let folder = folder();
    foveate(folder.path(), "scene generate demo --out demo.glb").succeeds();
    for file in ["demo.glb", "scene.glb"] {
        let run = foveate(folder.path(), &format!("tracker --replay {file} --json"));
        let (code, message) = run.refusal();
        assert!(code == "file" && message.contains("is no recording of a tracker"), "{run:?}");
    }
}

/// Each command takes the flags that it obeys, and no others.
#[test]
fn commands_refuse_flags_that_would_mean_nothing() {
    let folder = folder();
    for arguments in [
        "scene generate demo --out a.glb --devices 0",
        "scene generate demo --out a.glb --target-ms 5",
        "scene info scene.glb --preset fast",
        "devices --target-ms 5",
        "devices --preset fast",
        "devices --scene 1",
        "devices --camera 0",
        "tracker --devices 0",
        "tracker --target-ms 5",
        "bench scene.glb --rays 3",
        "bench scene.glb --target-ms 5",
        "measure scene.glb --out it --gaze 0,0",
        "measure scene.glb --out it --target-score 9",
    ] {
        let run = foveate(folder.path(), arguments);
        assert!(run.code == Some(2) && run.err.contains("unexpected argument"), "{arguments}: {run:?}");
    }
    for (arguments, flag) in [
        ("render scene.glb --out a.png --devices ", "--devices"),
        ("demo scene.glb --window --gaze 0.1,0.1", "--gaze"),
        ("demo scene.glb --window --position 1,1,1", "--position"),
        ("demo scene.glb --headset dk1 --fov-y 60", "--fov-y"),
    ] {
        let mut command = command(folder.path(), arguments);
        if arguments.ends_with(' ') {
            command.arg("");
        }
        assert!(run(command).sentence().starts_with(&format!("foveate: {flag}: ")), "{arguments}");
    }
    let run = foveate(folder.path(), "scene generate demo --out a.png");
    assert!(run.sentence().contains("ends in neither .glb nor .obj"), "{run:?}");
    assert_eq!(names(folder.path()), ["scene.glb"]);
}
