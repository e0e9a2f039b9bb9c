//! The tracker in a real kernel: QEMU runs Debian's, whose virtual USB controller has a virtual DK1, which the
//! program's own binary reads. `scripts/test-hid.sh` (`make test-hid`) fetches the kernel and runs this.

#[path = "../common/mod.rs"]
mod common;

mod archive;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use archive::Archive;

/// The kernel's modules that the test needs, in the order in which they need each other. What a kernel has
/// built in has no file.
const MODULES: [&str; 7] =
    ["usb-common", "usbcore", "hid", "usbhid", "hid-generic", "usbip-core", "vhci-hcd"];

/// The folder with `vmlinuz` and the modules; says so where there is none.
fn kernel() -> Option<PathBuf> {
    let folder = std::env::var_os("FOVEATE_TEST_KERNEL").map(PathBuf::from);
    if folder.is_none() {
        println!("not run: the tracker in a real kernel; `make test-hid` fetches one and runs this");
    }
    folder
}

/// The first process of the machine, which is built beside the tests.
fn guest() -> PathBuf {
    let mut folder = std::env::current_exe().unwrap();
    folder.pop();
    folder.pop();
    folder.join("examples/virtual-dk1")
}

/// The files of the machine.
fn initramfs(kernel: &Path, descriptor: &Path) -> Vec<u8> {
    let mut archive = Archive::default();
    for folder in ["dev", "sys", "proc", "tmp", "memory", "modules"] {
        archive.folder(folder);
    }
    for (program, name) in [(guest(), "init"), (PathBuf::from(env!("CARGO_BIN_EXE_foveate")), "foveate")] {
        for library in libraries(&program) {
            archive.program(library.trim_start_matches('/'), &std::fs::read(&library).unwrap());
        }
        archive.program(name, &stripped(&program));
    }
    archive.file("hid_report_descriptor.bin", &std::fs::read(descriptor).unwrap());
    let there = MODULES.map(|name| (name, kernel.join(format!("{name}.ko"))));
    let there: Vec<_> = there.iter().filter(|(_, path)| path.exists()).collect();
    for (name, path) in &there {
        archive.file(&format!("modules/{name}.ko"), &std::fs::read(path).unwrap());
    }
    let order: String = there.iter().map(|(name, _)| format!("{name}.ko\n")).collect();
    assert!(order.contains("vhci-hcd"), "the kernel has a virtual USB controller");
    archive.file("modules/order", order.as_bytes());
    archive.finish()
}

/// Shared libraries of a program, and the loader, by the paths under which they are found.
fn libraries(program: &Path) -> Vec<String> {
    // Where drivers are unpacked, programs start by a loader of their own (`build/drivers.rs`).
    let loader = std::env::var("FOVEATE_DRIVERS").ok().map(|folder| format!("{folder}/loader"));
    let mut command = Command::new(loader.as_deref().unwrap_or("ldd"));
    let output = command.args(loader.as_ref().map(|_| "--list")).arg(program).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let words = text.split_whitespace().filter(|word| word.starts_with('/'));
    words.map(str::to_string).chain(loader).collect()
}

/// A program without what only a debugger wants.
fn stripped(program: &Path) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let slim = folder.path().join("slim");
    let strip = Command::new("strip").arg("-o").arg(&slim).arg(program).status();
    let path = if strip.is_ok_and(|status| status.success()) { slim } else { program.to_path_buf() };
    std::fs::read(path).unwrap()
}

/// Runs the machine; whether it passed, and what it said.
fn machine(initramfs: &Path, kernel: &Path, words: &str) -> (bool, String) {
    let line = format!("console=ttyS0 quiet panic=-1 mitigations=off tsc=reliable no_timer_check {words}");
    // Its time counts instructions, so a busy host does not matter.
    let fixed = "-M pc -accel tcg -icount shift=3,sleep=off -cpu qemu64,+rdrand -smp 1 -m 512 -nodefaults \
                 -display none -serial stdio -no-reboot -device isa-debug-exit,iobase=0xf4,iosize=4";
    let output = Command::new("timeout")
        .args(["600", "qemu-system-x86_64"])
        .args(fixed.split_whitespace())
        .arg("-kernel")
        .arg(kernel.join("vmlinuz"))
        .arg("-initrd")
        .arg(initramfs)
        .args(["-append", &line])
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let passed = output.status.code() == Some(33) && said.lines().any(|line| line.trim() == "PASS");
    (passed, format!("{said}\n{}", String::from_utf8_lossy(&output.stderr)))
}

#[test]
fn the_program_reads_a_tracker_in_a_real_kernel_and_a_bad_one_is_found_out() {
    let Some(kernel) = kernel() else { return };
    let Some(descriptor) = common::data("dk1/hid_report_descriptor.bin") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("initramfs.cpio");
    std::fs::write(&path, initramfs(&kernel, &descriptor)).unwrap();
    let (passed, said) = machine(&path, &kernel, "");
    println!("{said}");
    assert!(passed, "{said}");
    for part in ["impostor", "descriptors", "streaming", "keep-alive", "lapse", "replug"] {
        assert!(said.contains(&format!("ok {part}")), "{part} was checked: {said}");
    }
    let (passed, said) = machine(&path, &kernel, "dk1.gaps");
    assert!(!passed && said.contains("FAIL") && said.contains("milliseconds lost"), "{said}");
}
