//! What the wearer sees, on a screen that is not there: Xvfb, Monado's real compositor and its remote-controlled
//! headset, whose pose and fields of view are sent to it.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use foveate::metrics::Display;

/// The compositor's window: both eyes side by side, each as its screen shows it.
pub const EYE_WIDTH: u32 = 480;
pub const EYE_HEIGHT: u32 = 540;
/// Tangents of the half angles of the remote headset's screens: 85 degrees, and as much higher as wide.
pub const SCREEN: [f64; 2] = [0.916_331, 0.986_75];

/// A screen in memory. Ends with this.
pub struct Screen {
    server: Child,
    name: String,
}

/// Whether a screen and a picture of it can be had; says so where not. A failure where CI=true promises them.
pub fn installed() -> bool {
    let there = ["Xvfb", "xwd"].iter().all(|program| {
        let started = Command::new(program).arg("-help").stdout(Stdio::null()).stderr(Stdio::null()).status();
        started.is_ok()
    });
    if !there {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "Xvfb and xwd are not installed");
        println!("not run: Xvfb and xwd are not installed (scripts/install-packages.sh test)");
    }
    there
}

impl Screen {
    /// Starts a server on a display of its own choice.
    pub fn start() -> Screen {
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1280x720x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        Screen { server, name: format!(":{}", number.trim()) }
    }

    /// For `DISPLAY`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What is on the screen at its upper left: the compositor's window.
    pub fn window(&self) -> Display {
        let command = ["-display", &self.name, "-root", "-silent"];
        let dump = Command::new("xwd").args(command).output().unwrap();
        assert!(dump.status.success(), "{}", String::from_utf8_lossy(&dump.stderr));
        pixels(&dump.stdout, 2 * EYE_WIDTH, EYE_HEIGHT)
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// The upper left part of an X window dump (X11/XWDFile.h) of 32 bits a pixel, blue first.
fn pixels(dump: &[u8], width: u32, height: u32) -> Display {
    let word = |index: usize| u32::from_be_bytes(dump[4 * index..4 * index + 4].try_into().unwrap()) as usize;
    let (header, bits, line, colours) = (word(0), word(11), word(12), word(19));
    assert_eq!((bits, word(7)), (32, 0), "bits a pixel, little end first");
    let start = header + 12 * colours;
    let mut rgba = Vec::new();
    for y in 0..height as usize {
        let row = &dump[start + y * line..][..4 * width as usize];
        rgba.extend(row.chunks(4).flat_map(|pixel| [pixel[2], pixel[1], pixel[0], 255]));
    }
    Display::from_rgba(width, height, &rgba)
}

/// An eye of the remote-controlled headset: angles to left, right, up and down, and its place in the head.
pub struct RemoteEye {
    pub fov: [f32; 4],
    pub position: [f32; 3],
}

/// Sends eyes and head to Monado's remote-controlled headset; they hold while the connection does.
/// The packet is `r_remote_data` of Monado's r_interface.h, version 3.
pub fn send(port: u16, eyes: [RemoteEye; 2], head: ([f32; 4], [f32; 3])) -> TcpStream {
    let mut packet = b"mndrmt3\0".to_vec();
    let floats = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let pose = |(rotation, position): ([f32; 4], [f32; 3])| [floats(&rotation), floats(&position)].concat();
    const AHEAD: [f32; 4] = [0.0, 0.0, 0.0, 1.0];
    for eye in eyes {
        packet.extend([floats(&eye.fov), pose((AHEAD, eye.position)), vec![0; 4]].concat());
    }
    packet.extend(pose(head));
    packet.extend([1, 0, 0, 0]);
    for _ in 0..2 {
        packet.extend(pose((AHEAD, [0.0; 3])));
        packet.extend([0; 92]);
    }
    assert_eq!(packet.len(), 376);
    let start = Instant::now();
    loop {
        match TcpStream::connect(("127.0.0.1", port)) {
            Ok(mut stream) => {
                stream.write_all(&packet).unwrap();
                return stream;
            }
            Err(error) => assert!(start.elapsed() < Duration::from_secs(30), "{error}"),
        }
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// A free port, and Monado's settings that make it listen there, in a folder of its own.
pub fn remote_settings(folder: &Path, screen: &Screen) -> (u16, Vec<(&'static str, String)>) {
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let config = folder.join("monado");
    std::fs::create_dir_all(&config).unwrap();
    let text =
        format!(r#"{{"active": "remote", "remote": {{"version": 0, "port": {port}, "view_count": 2}}}}"#);
    std::fs::write(config.join("config_v0.json"), text).unwrap();
    let settings = [
        ("XDG_CONFIG_HOME", folder.display().to_string()),
        ("P_OVERRIDE_ACTIVE_CONFIG", "remote".to_string()),
        ("XRT_COMPOSITOR_FORCE_XCB", "1".to_string()),
        ("XRT_COMPOSITOR_DEFAULT_FRAMERATE", "60".to_string()),
        ("DISPLAY", screen.name().to_string()),
        ("IPC_LOG", "trace".to_string()),
    ];
    (port, settings.to_vec())
}
