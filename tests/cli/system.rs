//! What the system lacks or takes away: drivers, readers, room on the disk.

use super::*;

fn without_drivers(folder: &Path, arguments: &str) -> Run {
    let mut command = command(folder, arguments);
    command.env("OCL_ICD_VENDORS", "/nonexistent").env("VK_DRIVER_FILES", "/nonexistent");
    command.env("VK_ICD_FILENAMES", "/nonexistent");
    run(command)
}

#[test]
fn devices_are_listed_with_what_is_used_and_why() {
    let here = Path::new(".");
    let told = foveate(here, "devices --json").succeeds().json();
    for kind in ["opencl", "vulkan", "presenters"] {
        let list = told[kind].as_array().unwrap();
        assert_eq!(list.iter().filter(|entry| entry["used"] == true).count(), 1, "{told}");
        assert!(list.iter().all(|entry| !entry["reason"].as_str().unwrap().is_empty()), "{told}");
    }
    assert_eq!(told["problems"], json!([]));
    let name = told["opencl"][0]["name"].as_str().unwrap();
    assert!(foveate(here, "devices").succeeds().out.contains(name));
    let unknown = foveate(here, "devices --json --set devices.opencl=voodoo2").succeeds().json();
    assert!(unknown["problems"][0].as_str().unwrap().contains("voodoo2"), "{unknown}");
}

#[test]
fn a_machine_without_drivers_is_told_what_to_install() {
    let folder = folder();
    let told = without_drivers(folder.path(), "devices --json").succeeds().json();
    assert_eq!((&told["opencl"], &told["vulkan"], &told["sharing"]), (&json!([]), &json!([]), &Value::Null));
    let problems = told["problems"].as_array().unwrap();
    assert_eq!(problems.len(), 2, "{told}");
    let text = without_drivers(folder.path(), "devices").succeeds().out;
    assert!(problems.iter().all(|problem| text.contains(problem.as_str().unwrap())), "{text}");
    for arguments in
        ["render scene.glb --out it.png", "mock scene.glb --out it", "scene info scene.glb", "demo --out it"]
    {
        let run = without_drivers(folder.path(), arguments);
        assert!(run.sentence().contains("install"), "{run:?}");
    }
    assert_eq!(names(folder.path()), ["scene.glb"]);
}

/// Runs the program in a shell line, where it is `$F`.
#[cfg(unix)]
fn shell(folder: &Path, line: &str) -> Run {
    let mut command = Command::new("sh");
    command.current_dir(folder).env("F", env!("CARGO_BIN_EXE_foveate")).args(["-c", line]);
    run(command)
}

#[cfg(unix)]
#[test]
fn readers_that_went_away_are_no_error() {
    let folder = folder();
    // The reader closes its end before the program writes.
    let gone = "{ sleep 0.3; $F ARGUMENTS; echo $? >code; } | true; cat code";
    for arguments in ["devices", "scene info scene.glb --json", "--help"] {
        let run = shell(folder.path(), &gone.replace("ARGUMENTS", arguments));
        assert_eq!((run.out.as_str(), run.err.as_str()), ("0\n", ""), "{arguments}");
    }
    let line = "{ sleep 0.3; $F render none.glb --out it.png; echo $? >code; } 2>&1 | true; cat code";
    assert_eq!(shell(folder.path(), line).out, "1\n", "nobody hears the complaint");
}

#[cfg(target_os = "linux")]
#[test]
fn output_that_cannot_be_written_is_told() {
    let run = shell(Path::new("."), "$F devices >/dev/full");
    assert!(run.sentence().contains("standard output: the disk is full"), "{run:?}");
}

/// A limit on the size of files stands for a full disk: a file's end does not fit.
#[cfg(target_os = "linux")]
#[test]
fn a_picture_that_does_not_fit_on_the_disk_leaves_the_old_one() {
    let folder = folder();
    let view = "render scene.glb --width 1024 --height 768 --samples full --rays 1 --position 0,1,4";
    // The OpenCL driver caches kernels in files too, below the limit; they are there after a first run.
    foveate(folder.path(), &format!("{view} --out warm.png")).succeeds();
    for name in ["it.png", "it.exr"] {
        std::fs::write(folder.path().join(name), "the old one").unwrap();
        let run = shell(folder.path(), &format!("trap '' XFSZ; ulimit -f 1024; exec $F {view} --out {name}"));
        assert_eq!((run.code, run.out.as_str()), (Some(1), ""), "{run:?}");
        assert!(run.err.starts_with(&format!("foveate: {name}: it cannot be written")), "{run:?}");
        assert_eq!(std::fs::read(folder.path().join(name)).unwrap(), b"the old one");
    }
    assert_eq!(names(folder.path()), ["it.exr", "it.png", "scene.glb", "warm.png"]);
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_in_the_place_of_files_are_refused() {
    let folder = folder();
    for pipe in ["pipe.glb", "pipe.hdr", "pipe.exr", "pipe.png", "pipe.toml"] {
        Command::new("mkfifo").arg(folder.path().join(pipe)).status().unwrap();
    }
    for arguments in [
        "render pipe.glb --out it.png",
        "render /dev/zero --out it.png",
        "render scene.glb --out it.png --environment pipe.hdr",
        "render scene.glb --out it.png --environment pipe.exr",
        "render scene.glb --out it.png --config pipe.toml",
        "render scene.glb --out it.png --config /dev/zero",
        "render scene.glb --out pipe.png",
        "scene info pipe.glb",
        "scene generate demo --out pipe.glb",
        "tracker --replay /dev/zero",
    ] {
        let run = foveate(folder.path(), arguments);
        let sentence = run.sentence();
        assert!(sentence.contains("not a regular file") || sentence.contains("not a file"), "{run:?}");
    }
}
