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
    let unknown = foveate(here, "devices --json --set devices.opencl=voodoo2");
    assert_eq!(unknown.code, Some(1), "{unknown:?}");
    let unknown = unknown.json();
    assert!(unknown["problems"][0].as_str().unwrap().contains("voodoo2"), "{unknown}");
}

#[test]
fn a_machine_without_drivers_is_told_what_to_install() {
    let folder = folder();
    let run = without_drivers(folder.path(), "devices --json");
    assert_eq!(run.code, Some(1), "nothing can be used: {run:?}");
    let told = run.json();
    assert_eq!((&told["opencl"], &told["vulkan"], &told["sharing"]), (&json!([]), &json!([]), &Value::Null));
    let problems = told["problems"].as_array().unwrap();
    assert_eq!(problems.len(), 2, "{told}");
    let text = without_drivers(folder.path(), "devices").out;
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

/// A limit on the size of files stands for a full disk: the end of the file does not fit. Pictures are
/// written in the same way, but drivers, which write files of their own, cannot run under such a limit.
#[cfg(target_os = "linux")]
#[test]
fn a_file_that_does_not_fit_on_the_disk_leaves_the_old_one() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("it.glb"), "glTF, the old one").unwrap();
    let line =
        "trap '' XFSZ; ulimit -f 512; exec $F scene generate voxel-town --triangles 12000 --out it.glb";
    let run = shell(folder.path(), line);
    assert_eq!((run.code, run.out.as_str()), (Some(1), ""), "{run:?}");
    assert!(run.err.starts_with("foveate: it.glb: files may not become so large here"), "{run:?}");
    assert_eq!(names(folder.path()), ["it.glb"]);
    assert_eq!(std::fs::read(folder.path().join("it.glb")).unwrap(), b"glTF, the old one");
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

/// A home that cannot be written takes no driver away, and is said.
#[cfg(target_os = "linux")]
#[test]
fn a_home_that_cannot_be_written_takes_no_driver_away() {
    let folder = folder();
    let runtime = folder.path().join("runtime");
    std::fs::create_dir(&runtime).unwrap();
    // Not even root makes a folder below a file.
    for home in ["/dev/null", "/dev/null/home"] {
        let mut command =
            command(folder.path(), "render scene.glb --out it.png --width 32 --height 20 --rays 1");
        command.env("HOME", home).env("XDG_RUNTIME_DIR", &runtime).env_remove("XDG_CACHE_HOME");
        command.env_remove("POCL_CACHE_DIR");
        let run = run(command);
        assert_eq!(run.code, Some(0), "{run:?}");
        assert!(run.err.starts_with("foveate: note: caches cannot be kept in /dev/null"), "{run:?}");
        assert!(run.err.lines().count() == 1 && run.err.contains("XDG_CACHE_HOME"), "{run:?}");
    }
    assert!(runtime.join("foveate-cache").is_dir());
    let mut command = command(folder.path(), "devices --json");
    command.env("HOME", "/dev/null").env("XDG_RUNTIME_DIR", &runtime).env_remove("XDG_CACHE_HOME");
    let told = run(command);
    assert_eq!(told.code, Some(0), "{told:?}");
    assert_eq!(told.json()["problems"], json!([]), "no driver is said to be missing");
}

/// Too little memory is told as the reason, whatever drivers make of it, and is not taken for missing drivers.
#[cfg(target_os = "linux")]
#[test]
fn little_memory_is_told_as_the_reason() {
    let folder = folder();
    for limit in [300_000, 600_000] {
        let line = format!(
            "ulimit -v {limit}; exec $F render scene.glb --out it.png --width 32 --height 20 --rays 1"
        );
        let run = shell(folder.path(), &line);
        let told = run.err.contains("memory") && run.err.contains("ulimit -v");
        assert!(run.code != Some(0) && told, "{limit}: {run:?}");
        assert!(!run.err.contains("driver is installed"), "{limit}: {run:?}");
        assert!(!folder.path().join("it.png").exists());
    }
}

/// What is wrong with the scene is told before what the machine lacks.
#[test]
fn a_scene_that_is_not_there_comes_before_a_missing_headset() {
    let folder = folder();
    for arguments in ["run nope.glb", "demo nope.glb --out it", "mock nope.glb --out it"] {
        let run = without_drivers(folder.path(), arguments);
        assert!(run.sentence().contains("nope.glb: there is no such file"), "{run:?}");
    }
}

/// On a terminal each step of loading is named while it lasts.
#[cfg(target_os = "linux")]
#[test]
fn a_terminal_is_told_what_is_waited_for() {
    let folder = folder();
    // `script` runs it on a terminal of its own.
    let line = "XDG_CACHE_HOME=$PWD/cache TERM=xterm exec script -qec \
                \"$F mock scene.glb --out it --frames 2 --width 64 --height 24 --rays 1\" /dev/null";
    let told = shell(folder.path(), line);
    assert_eq!(told.code, Some(0), "{told:?}");
    for step in ["kernels and upload", "measuring which kernels are faster", "first frames", "frames ["] {
        assert!(told.out.contains(step), "{step}: {told:?}");
    }
    // Elsewhere nothing of it is in the way.
    foveate(folder.path(), "mock scene.glb --out it --frames 2 --width 64 --height 24 --rays 1").succeeds();
}

#[test]
fn the_version_tells_what_it_was_built_from() {
    let told = foveate(Path::new("."), "--version").succeeds().out;
    let version =
        told.trim().strip_prefix(concat!("foveate ", env!("CARGO_PKG_VERSION"), " (")).expect("the version");
    assert!(version.starts_with("development build)") || version.starts_with("commit "), "{told}");
}
