//! The first process of a virtual machine with a Debian kernel: plugs a virtual DK1 into the kernel's virtual
//! USB controller, has the program's own binary read it, and checks both ends.

mod checks;
mod dk1;
mod usbip;

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};

use nix::kmod::{ModuleInitFlags, finit_module};
use nix::mount::{MsFlags, mount};

fn main() {
    let none = None::<&str>;
    for (kind, folder) in [("devtmpfs", "/dev"), ("sysfs", "/sys"), ("proc", "/proc")] {
        mount(Some(kind), folder, Some(kind), MsFlags::empty(), none).unwrap();
    }
    std::panic::set_hook(Box::new(|panic| say(&format!("FAIL {panic}"))));
    let passed = std::panic::catch_unwind(|| {
        load_modules();
        let flawed = std::fs::read_to_string("/proc/cmdline").unwrap().contains("dk1.gaps");
        checks::run(flawed.then_some(dk1::Flaw::Gaps));
    });
    if passed.is_ok() {
        say("PASS");
    }
    leave(if passed.is_ok() { 0x10 } else { 0x11 });
}

/// A line for the machine that runs this one.
fn say(line: &str) {
    let mut serial = File::options().write(true).open("/dev/ttyS0").unwrap();
    writeln!(serial, "{line}").unwrap();
}

/// Loads what the kernel has as modules, in the order in which they need each other.
fn load_modules() {
    let order = std::fs::read_to_string("/modules/order").unwrap();
    for name in order.lines() {
        let module = File::open(format!("/modules/{name}")).unwrap();
        let loaded = finit_module(&module, c"", ModuleInitFlags::empty());
        assert!(matches!(loaded, Ok(()) | Err(nix::errno::Errno::EEXIST)), "{name}: {loaded:?}");
    }
}

/// Ends the machine by its debug port, with a status of 2 x + 1.
fn leave(status: u8) -> ! {
    let mut ports = File::options().write(true).open("/dev/port").unwrap();
    ports.seek(SeekFrom::Start(0xf4)).unwrap();
    ports.write_all(&[status]).unwrap();
    loop {
        std::thread::park();
    }
}
