//! Embree, in a program of its own: see `embree.cpp`.

use std::fmt;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use foveate::trace::probe::RayKind;

/// Compiles the program for this machine.
pub fn compile(out: &Path) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peers/embree.cpp");
    let program = out.join("embree");
    // Where the system's Embree is too old, one is unpacked beside the drivers (`scripts/unpack-drivers.sh`).
    let unpacked = std::env::var("FOVEATE_DRIVERS").ok().map_or(Vec::new(), |folder| {
        let paths = std::fs::read_to_string(format!("{folder}/paths")).expect("unpacked drivers");
        let mut options =
            vec![format!("-I{folder}/usr/include"), format!("-Wl,--dynamic-linker={folder}/loader")];
        options.extend(paths.trim().split(':').map(|path| format!("-L{path}")));
        options.push(format!("-Wl,--allow-shlib-undefined,--disable-new-dtags,-rpath,{}", paths.trim()));
        options
    });
    let done = Command::new("g++")
        .args(unpacked)
        .args(["-O3", "-march=native", "-std=c++17"])
        .args([&source, Path::new("-o"), &program])
        .args(["-lembree4", "-lpthread"])
        .status()
        .expect("g++; scripts/install-packages.sh bench installs it");
    assert!(
        done.success(),
        "embree.cpp does not compile; scripts/install-packages.sh bench installs Embree 4"
    );
    program
}

/// How Embree is asked.
#[derive(Clone, Debug)]
pub struct Way {
    kind: RayKind,
    width: u32,
    coherent: bool,
}

impl Way {
    /// All of them.
    pub fn all(kind: RayKind) -> Vec<Way> {
        [1, 4, 8, 16]
            .into_iter()
            .flat_map(|width| [false, true].map(|coherent| Way { kind, width, coherent }))
            .collect()
    }
}

impl fmt::Display for Way {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let call = if self.kind == RayKind::Occlusion { "rtcOccluded" } else { "rtcIntersect" };
        write!(f, "{call}{}, {}", self.width, if self.coherent { "coherent" } else { "incoherent" })
    }
}

/// What a run told.
pub struct Run {
    /// Milliseconds of all processors.
    pub cpu_ms: f64,
    /// Answers that are not the kernels'.
    pub wrong: usize,
}

/// The program under way.
pub struct Embree {
    child: Child,
    ask: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Embree {
    pub fn start(program: &Path, rays: &Path, config: &str) -> Embree {
        let mut command = Command::new(program);
        command.arg(rays).stdin(Stdio::piped()).stdout(Stdio::piped());
        if !config.is_empty() {
            command.arg(config);
        }
        let mut child = command.spawn().expect("Embree");
        let (ask, answers) = (child.stdin.take().expect("a pipe"), child.stdout.take().expect("a pipe"));
        Embree { child, ask, answers: BufReader::new(answers) }
    }

    /// Milliseconds of wall time to build a tree.
    pub fn build(&mut self, quality: &str) -> f64 {
        self.words(&format!("build {quality}"))[0]
    }

    pub fn trace(&mut self, way: &Way) -> Run {
        let what = if way.kind == RayKind::Occlusion { "occluded" } else { "intersect" };
        let rays = match way.kind {
            RayKind::Pixels => "pixels",
            RayKind::Samples => "samples",
            RayKind::Occlusion | RayKind::Bounce => "bundles",
        };
        let flag = if way.coherent { "coherent" } else { "incoherent" };
        let words = self.words(&format!("{what} {rays} {} {flag}", way.width));
        Run { cpu_ms: words[1], wrong: words[2] as usize }
    }

    fn words(&mut self, line: &str) -> Vec<f64> {
        writeln!(self.ask, "{line}").expect("Embree listens");
        let mut answer = String::new();
        self.answers.read_line(&mut answer).expect("Embree answers");
        let words: Vec<f64> = answer.split_whitespace().map(|word| word.parse().expect("a number")).collect();
        assert!(!words.is_empty(), "Embree has ended; see above");
        words
    }
}

impl Drop for Embree {
    fn drop(&mut self) {
        // It has nothing to lose.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
