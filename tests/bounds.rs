//! No kernel leaves its buffers: frames under a layer of OpenCL (`tests/guarded_buffers`) that puts each buffer between pages which
//! nobody may touch, and ends a program whose kernels do. What Vulkan shares lies elsewhere, and is not held so.
#![cfg(unix)]

use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use foveate::gpu::opencl::device;
use foveate::gpu::opencl::{Arg, Buffer, Device, DeviceInfo, Program};

/// Of a child of this program: by how many elements its kernel leaves a buffer of seven, or -1.
const CHILD: &str = "FOVEATE_TEST_LEAVES_BY";

const SOURCE: &str = "__kernel void leave(__global uint *at, uint by)\n{\n    at[(int)by] += 1u;\n}\n";

/// The layer, which cargo builds beside the tests that depend on it.
fn layer() -> PathBuf {
    let name = format!("{}guarded_buffers{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let path = std::env::current_exe().unwrap().with_file_name(name);
    assert!(path.exists(), "{} is not there", path.display());
    path
}

/// A device whose drivers use the host's memory in place.
fn processor() -> Option<DeviceInfo> {
    let usable = |info: &DeviceInfo| info.unusable.is_none() && info.kind == "cpu";
    let found = device::list().into_iter().find(usable);
    if found.is_none() {
        println!("not run: there is no OpenCL device that is a processor");
    }
    found
}

/// This program again, whose kernel leaves its buffer by so much.
fn child(by: i32, side: &str) -> Output {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "a_kernel_that_leaves_its_buffer_ends_the_program"]).env(CHILD, by.to_string());
    guarded(command, side)
}

/// Whether the loader of OpenCL takes layers: those before ocl-icd 2.3 do not.
fn takes_layers() -> bool {
    let takes = String::from_utf8_lossy(&child(0, "back").stderr).contains(guarded_buffers::ON);
    if !takes {
        println!("not run: this machine's loader of OpenCL takes no layers");
    }
    takes
}

fn guarded(mut command: Command, side: &str) -> Output {
    command.env("OPENCL_LAYERS", layer()).env("GUARD", side).output().unwrap()
}

#[test]
fn a_kernel_that_leaves_its_buffer_ends_the_program() {
    let Some(info) = processor() else { return };
    if let Ok(by) = std::env::var(CHILD) {
        let device = Device::open(&info).unwrap();
        let kernel =
            Program::build(&device, "leave", SOURCE, "-cl-std=CL1.2").unwrap().kernel("leave").unwrap();
        let buffer = Buffer::from_slice(&device, &[1u32; 7]).unwrap();
        let by: i32 = by.parse().unwrap();
        kernel.launch(&[Arg::buffer(&buffer), Arg::U32(by as u32)], 1, 1).unwrap();
        let counted: u32 = buffer.to_vec().unwrap().iter().sum();
        assert_eq!(counted, 8, "copied, and counted in place");
        return;
    }
    if !takes_layers() {
        return;
    }
    for (by, side, is_inside) in
        [(0, "back", true), (6, "back", true), (7, "back", false), (0, "front", true), (-1, "front", false)]
    {
        let output = child(by, side);
        let ended = if is_inside { output.status.success() } else { output.status.signal() == Some(11) };
        assert!(ended, "element {by} of 7, guarded at the {side}: {output:?}");
    }
}

/// The program with arguments in one string, in a folder; under the layer where a side is named.
fn foveate(folder: &Path, arguments: &str, side: Option<&str>) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command.current_dir(folder).args(arguments.split_whitespace());
    let output = match side {
        Some(side) => guarded(command, side),
        None => command.output().unwrap(),
    };
    assert!(output.status.success(), "{arguments}, guarded at {side:?}: {output:?}");
}

#[test]
fn kernels_of_frames_stay_inside_of_their_buffers() {
    if processor().is_none() || !takes_layers() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    foveate(folder, "scene generate demo --out demo.glb", None);
    for traversal in ["packet", "single-ray"] {
        for (method, more) in [("guided", "--bounces 1"), ("k-nn", "")] {
            let render = |out: &str, side| {
                let arguments = format!(
                    "render demo.glb --out {out}.png --width 101 --height 67 --samples 777 --rays 40 \
                     --reconstruct {method} --set trace.traversal={traversal} {more}"
                );
                foveate(folder, &arguments, side);
                std::fs::read(folder.join(out).with_extension("png")).unwrap()
            };
            let plain = render("plain", None);
            for side in ["back", "front"] {
                assert!(render(side, Some(side)) == plain, "{traversal}, {method}, {side}: another picture");
            }
        }
        // Frames that know of those before, with a gaze that moves, patterns made by the device and things that move.
        let mock = format!(
            "mock demo.glb --frames 5 --out frames --width 102 --height 67 --samples 777 --set trace.traversal={traversal}"
        );
        for side in ["back", "front"] {
            foveate(folder, &mock, Some(side));
        }
    }
}
