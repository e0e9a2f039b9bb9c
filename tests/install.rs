//! The scripts that make a machine ready leave it as it was: nothing that is installed changes, what is unpacked is
//! this program's alone, and all of it can be undone. Their tools are stand-ins that write down what they are asked.
#![cfg(unix)]

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A checkout's scripts in a folder of their own, with a home and stand-ins for the system's tools.
struct Sandbox {
    folder: tempfile::TempDir,
}

impl Sandbox {
    fn new() -> Sandbox {
        let sandbox = Sandbox { folder: tempfile::tempdir().unwrap() };
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        for folder in ["scripts", ".cargo", "tools", "home"] {
            std::fs::create_dir(sandbox.path(folder)).unwrap();
        }
        for entry in std::fs::read_dir(root.join("scripts")).unwrap() {
            let entry = entry.unwrap();
            std::fs::copy(entry.path(), sandbox.path("scripts").join(entry.file_name())).unwrap();
        }
        sandbox
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn data(&self, name: &str) -> PathBuf {
        self.path("home/.local/share/foveate").join(name)
    }

    /// A tool that notes its arguments and does what these lines of shell say.
    fn tool(&self, name: &str, lines: &str) {
        let path = self.path("tools").join(name);
        let note = format!("echo \"{name} $*\" >>'{}'", self.path("asked").display());
        std::fs::write(&path, format!("#!/bin/bash\n{note}\n{lines}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    }

    fn run(&self, line: &str) -> (Output, String) {
        let tools = format!("{}:{}", self.path("tools").display(), std::env::var("PATH").unwrap());
        let mut command = Command::new("bash");
        command.args(["-c", line]).current_dir(self.folder.path()).env("PATH", tools);
        command.env("HOME", self.path("home")).env_remove("XDG_DATA_HOME");
        // What these scripts have done to this machine is not a test's to undo.
        command.env("FOVEATE_TEST_ROOT", self.path("system"));
        let output = command.output().unwrap();
        let text =
            String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        (output, text)
    }

    fn asked(&self) -> String {
        std::fs::read_to_string(self.path("asked")).unwrap_or_default()
    }
}

/// A dpkg-query whose packages change when the file `changed` is there.
fn packages(sandbox: &Sandbox, after: &str) {
    let lines = format!(
        "if [[ -e changed ]]; then {after}; else printf 'installed libc6:amd64 2.36\\ninstalled bash:amd64 5.2\\n'; fi"
    );
    sandbox.tool("dpkg-query", &lines);
    sandbox.tool(
        "apt-cache",
        "echo ' bash | 5.2+deb12u1 | http://deb.debian.org/debian bookworm/main amd64 Packages'",
    );
}

#[test]
fn a_changed_package_is_noticed() {
    for (after, code, part) in [
        (
            "printf 'installed libc6:amd64 2.36\\ninstalled bash:amd64 5.2\\ninstalled new:amd64 1\\n'",
            0,
            "none was changed",
        ),
        (
            "printf 'installed libc6:amd64 2.41\\ninstalled bash:amd64 5.2\\n'",
            1,
            "libc6:amd64 2.36 is 2.41 now",
        ),
        ("printf 'installed libc6:amd64 2.36\\n'", 1, "bash:amd64 5.2 is gone now"),
    ] {
        let sandbox = Sandbox::new();
        packages(&sandbox, after);
        let (output, text) = sandbox.run("scripts/check-packages.sh touch changed");
        assert!(output.status.code() == Some(code) && text.contains(part), "{text}");
    }
    let sandbox = Sandbox::new();
    packages(&sandbox, "true");
    let (output, _) = sandbox.run("scripts/check-packages.sh sh -c 'exit 7'");
    assert_eq!(output.status.code(), Some(7), "the command's own failure stays");
}

/// Debian 12: its archive has loaders, but drivers that are too old.
fn old_release(sandbox: &Sandbox) {
    sandbox.tool("dpkg-query", "echo 'not-installed '");
    sandbox.tool("apt-cache", "echo '  Candidate: 3.1-1'");
    sandbox.tool("sudo", "\"$@\"");
    sandbox
        .tool("cc", "while [[ $1 != -o ]]; do shift; done; printf '#!/bin/sh\\nexit 1\\n' >$2; chmod +x $2");
    let plan = "case \"$*\" in *' -s '*|'-s '*) echo 'Inst libvulkan1 (1.3)';; *print-uris*) echo \"'http://a/b.deb' b.deb 5000000\";; esac";
    sandbox.tool("apt-get", plan);
    // What is unpacked is not fetched in a test.
    let unpack = "#!/bin/bash\necho \"unpack $*\" >>asked\n";
    std::fs::write(sandbox.path("scripts/unpack-drivers.sh"), unpack).unwrap();
}

#[test]
fn drivers_that_are_too_old_are_unpacked_and_none_is_upgraded() {
    let sandbox = Sandbox::new();
    old_release(&sandbox);
    let (output, text) = sandbox.run("scripts/install-packages.sh demo");
    assert!(output.status.success(), "{text}");
    assert!(text.contains("from this release: 1 packages, 5 MB to download"), "{text}");
    let asked = sandbox.asked();
    assert!(asked.contains("unpack pocl-opencl-icd mesa-vulkan-drivers"), "{asked}");
    for line in asked.lines().filter(|line| line.starts_with("apt-get") && line.contains("install")) {
        let other =
            [" -t ", "--target-release", "pocl", "mesa", "upgrade"].into_iter().find(|w| line.contains(w));
        assert!(other.is_none(), "{line}");
    }
    assert_eq!(std::fs::read_to_string(sandbox.data("installed-packages")).unwrap().trim(), "libvulkan1");
}

/// A package for which others would have to go is unpacked, or refused, but never installed.
#[test]
fn nothing_is_removed_for_what_is_new() {
    let sandbox = Sandbox::new();
    old_release(&sandbox);
    let plan = "case \"$*\" in *--no-remove*qemu*) exit 100;; *-s*qemu*) echo 'Remv qemu-utils [10]'; seq -f 'Inst package%g (7)' 100000;; esac";
    sandbox.tool("apt-get", plan);
    let (output, text) = sandbox.run("scripts/install-packages.sh hid");
    let asked = sandbox.asked();
    assert!(output.status.success() && asked.contains("unpack --tools qemu-system-x86\n"), "{text}: {asked}");
    let installs = asked.lines().filter(|line| line.starts_with("apt-get install"));
    assert!(installs.clone().count() > 0 && installs.clone().all(|line| !line.contains("qemu")), "{asked}");

    let plan = "case \"$*\" in *--no-remove*) exit 100;; esac";
    sandbox.tool("apt-get", plan);
    let (output, text) = sandbox.run("scripts/install-packages.sh hid");
    assert!(!output.status.success() && text.contains("without removing other packages"), "{text}");
}

#[test]
fn drivers_that_work_are_left_alone() {
    let sandbox = Sandbox::new();
    old_release(&sandbox);
    sandbox
        .tool("cc", "while [[ $1 != -o ]]; do shift; done; printf '#!/bin/sh\\nexit 0\\n' >$2; chmod +x $2");
    let (output, text) = sandbox.run("scripts/install-packages.sh demo");
    assert!(output.status.success() && sandbox.asked().contains("unpack \n"), "{text}: {}", sandbox.asked());
}

#[test]
fn a_release_whose_drivers_are_new_enough_gives_them() {
    let sandbox = Sandbox::new();
    old_release(&sandbox);
    sandbox.tool("apt-cache", "echo '  Candidate: 1:26.0-1'");
    let (output, text) = sandbox.run("scripts/install-packages.sh demo");
    let asked = sandbox.asked();
    assert!(output.status.success() && asked.contains("unpack \n"), "{text}: {asked}");
    assert!(text.contains("installing pocl-opencl-icd mesa-vulkan-drivers from this release"), "{text}");
}

#[test]
fn without_packages_cargo_is_told_of_no_drivers_and_others_files_stay() {
    let sandbox = Sandbox::new();
    let config = sandbox.path(".cargo/config.toml");
    std::fs::write(&config, "[net]\noffline = true\n").unwrap();
    assert!(sandbox.run("scripts/unpack-drivers.sh").0.status.success() && config.exists());
    let (output, text) = sandbox.run("scripts/unpack-drivers.sh pocl-opencl-icd");
    assert!(!output.status.success() && text.contains("is not of this script"), "{text}");
    std::fs::write(&config, "# Written by scripts/unpack-drivers.sh; make uninstall removes it.\n[env]\n")
        .unwrap();
    assert!(sandbox.run("scripts/unpack-drivers.sh").0.status.success() && !config.exists());
}

#[test]
fn what_was_unpacked_is_told_to_cargo_and_goes_again() {
    let sandbox = Sandbox::new();
    let drivers = sandbox.data("drivers");
    std::fs::create_dir_all(&drivers).unwrap();
    std::fs::write(drivers.join("asked"), "mesa-vulkan-drivers\npocl-opencl-icd\n").unwrap();
    let config = sandbox.path(".cargo/config.toml");
    let (output, text) = sandbox.run("scripts/unpack-drivers.sh pocl-opencl-icd");
    assert!(
        output.status.success() && !sandbox.asked().contains("apt-get"),
        "nothing is fetched again: {text}"
    );
    let told: toml::Table = std::fs::read_to_string(&config).unwrap().parse().unwrap();
    let vendors = drivers.join("etc/OpenCL/vendors").display().to_string();
    assert_eq!(told["env"]["OCL_ICD_VENDORS"].as_str(), Some(vendors.as_str()));
    assert_eq!(told["env"]["FOVEATE_DRIVERS"].as_str(), drivers.to_str());
    // Vulkan works here without: a graphics card's driver stays in use.
    assert!(told["env"].get("VK_DRIVER_FILES").is_none(), "{told}");

    std::fs::write(sandbox.data("installed-packages"), "xvfb\ngone\n").unwrap();
    std::fs::write(sandbox.path("home/mine"), "kept").unwrap();
    let old_list = sandbox.path("system/etc/apt/sources.list.d/foveate-trixie.list");
    std::fs::create_dir_all(old_list.parent().unwrap()).unwrap();
    std::fs::write(&old_list, "deb trixie").unwrap();
    sandbox.tool("dpkg-query", "case \"$*\" in *xvfb*) echo installed;; esac");
    sandbox.tool("apt-get", "case \"$*\" in *'-s '*) echo 'Remv xvfb [2:21]';; esac");
    sandbox.tool("sudo", "\"$@\"");
    let (output, text) = sandbox.run("scripts/uninstall.sh");
    assert!(output.status.success(), "{text}");
    assert!(!config.exists() && !drivers.exists() && !sandbox.data("").exists(), "{text}");
    assert!(sandbox.path("home/mine").exists() && !old_list.exists(), "{text}");
    assert!(sandbox.asked().contains("apt-get remove --purge -y -qq xvfb\n"), "{}", sandbox.asked());
}

#[test]
fn packages_that_others_need_by_now_stay() {
    let sandbox = Sandbox::new();
    std::fs::create_dir_all(sandbox.data("")).unwrap();
    std::fs::write(sandbox.data("installed-packages"), "g++\nxvfb\n").unwrap();
    sandbox.tool("dpkg-query", "echo installed");
    let along = "case \"$*\" in *'-s '*g++*) echo 'Remv g++ [1]'; echo 'Remv theirs [1]';; *'-s '*) echo 'Remv xvfb [1]';; esac";
    sandbox.tool("apt-get", along);
    sandbox.tool("sudo", "\"$@\"");
    let (output, text) = sandbox.run("scripts/uninstall.sh");
    assert!(output.status.success() && text.contains("kept what other packages need by now: g++"), "{text}");
    assert!(sandbox.asked().contains("remove --purge -y -qq xvfb\n"), "{}", sandbox.asked());
}

/// Where drivers work, the probe says so as the program does.
#[test]
fn the_probe_agrees_with_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let (probe, source) =
        (folder.path().join("probe"), Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/probe-drivers.c"));
    let compiled = Command::new("cc").arg("-o").args([&probe, &source]).arg("-ldl").status();
    if !compiled.is_ok_and(|status| status.success()) {
        println!("not run: the probe for drivers (no C compiler)");
        return;
    }
    // Unpacked drivers need a C library of their own, which the probe has not.
    let asks = |kind: &str, name: &str, value: &str| {
        Command::new(&probe).arg(kind).env(name, value).status().unwrap().success()
    };
    assert!(!asks("opencl", "OCL_ICD_VENDORS", "/nonexistent"));
    assert!(!asks("vulkan", "VK_DRIVER_FILES", "/nonexistent"));
    if std::env::var_os("FOVEATE_DRIVERS").is_none() {
        let there = foveate::gpu::opencl::device::list().iter().any(|device| device.unusable.is_none());
        assert_eq!(asks("opencl", "NO", "MATTER"), there);
        assert_eq!(
            asks("vulkan", "NO", "MATTER"),
            foveate::gpu::vulkan::devices().is_ok_and(|all| !all.is_empty())
        );
    }
}
