//! Work that a driver may end, hang or spoil, done in a process of its own: whatever happens there, this one lives,
//! and can say what was being done.
//!
//! The other process is this program again. It tells on standard output what it begins ([`stage`]) and what it found
//! ([`answer`]), in lines with a mark, since drivers print there too. Its standard input stays open for as long as
//! whoever started it lives; when that is closed, it ends.
//!
//! **Kernels tried by another process.** A driver may crash, hang or answer wrongly over a kernel: Mesa's
//! rusticl ended the program over a compiler's builtin, and Intel's CPU runtime finds wrong hits in one
//! variant. So the program starts itself (`foveate try-kernels`, hidden) to build and try each variant before
//! it builds it in its own process: first the hits of 750 rays against the reference, then times. Where the
//! process ends without an answer, each variant gets one to itself; one that fails, crashes or is silent for
//! five minutes is out, with what was being done and the driver's last words as the reason, and the other is
//! taken. The kernels of a scene's frames are tried the same way once for each driver, text and set of
//! features, and those of patterns before a gaze that moves first wants one (`src/bench/patterns.rs`); where these fail
//! the host makes patterns. Verdicts are kept beside the measurements, failures for a day. `foveate devices` asks everything
//! in another process, part by part, and leaves out what ended it. Memory that a driver sets aside for
//! work-items' stacks counts when a scene is held against a graphics card's memory
//! (`SceneData::check_fit_beside`). `scripts/opencl-drivers.sh` unpacks both of these drivers, without
//! installing them.

use std::fmt;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

/// How long the other process may be silent: some drivers build kernels for minutes.
pub const PATIENCE: Duration = Duration::from_secs(300);
/// Begins the lines that are ours.
const STAGE: &str = "@foveate stage ";
const ANSWER: &str = "@foveate answer ";
/// Of either output so much is read.
const MOST_BYTES: u64 = 1 << 20;

static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
static WORKING: AtomicBool = AtomicBool::new(false);

/// Says which program does isolated work: the binary calls this with its own path. Until then, as in tests of the
/// library, such work is done in place.
pub fn use_program(program: PathBuf) {
    let _ = PROGRAM.set(program);
}

/// The program that does isolated work, where one was named.
pub fn program() -> Option<&'static Path> {
    PROGRAM.get().map(PathBuf::as_path)
}

/// The other process' side: from now on stages and answers are told, and the process ends with whoever started it.
pub fn work_for_others() {
    WORKING.store(true, Ordering::Relaxed);
    std::thread::spawn(|| {
        let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
        std::process::exit(1);
    });
}

/// Tells what is begun; nothing where nobody asked.
pub fn stage(what: &str) {
    if WORKING.load(Ordering::Relaxed) {
        tell(STAGE, what);
    }
}

/// Tells what was found: one line of it.
pub fn answer(what: &str) {
    tell(ANSWER, what);
}

fn tell(mark: &str, what: &str) {
    let mut out = std::io::stdout().lock();
    // A driver may have left a line of its own open.
    let _ = writeln!(out, "\n{mark}{}", what.replace('\n', " ")).and_then(|()| out.flush());
}

/// How isolated work ended without an answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// What was done last, such as `building the kernels`; empty before anything was.
    pub stage: String,
    /// How it ended, such as `crashed (SIGSEGV)`.
    pub how: String,
    /// The last line on standard error: of a driver, mostly.
    pub last_words: String,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let stage = if self.stage.is_empty() { "starting" } else { &self.stage };
        write!(f, "its driver {} while {stage}", self.how)?;
        if !self.last_words.is_empty() {
            write!(f, " (it said: {})", self.last_words)?;
        }
        Ok(())
    }
}

/// Has `program` do something in a process of its own, and returns the answer. `patience` is how long it may be
/// silent.
///
/// # Errors
/// Where it ends, or is ended, without an answer.
pub fn run(program: &Path, args: &[String], patience: Duration) -> Result<String, Failure> {
    let failure = |stage: String, how: String, last_words: String| Failure { stage, how, last_words };
    let mut command = Command::new(program);
    command.args(args).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command
        .spawn()
        .map_err(|e| failure(String::new(), format!("could not be tried ({e})"), String::new()))?;
    // Closed when this function returns.
    let _alive = child.stdin.take();
    let heard = lines(child.stdout.take());
    let said = lines(child.stderr.take());
    let mut at = String::new();
    let (answer, ended) = loop {
        match heard.recv_timeout(patience) {
            Ok(line) => {
                if let Some(what) = line.strip_prefix(STAGE) {
                    at = what.to_string();
                    stage(what);
                } else if let Some(what) = line.strip_prefix(ANSWER) {
                    break (Some(what.to_string()), None);
                }
            }
            Err(RecvTimeoutError::Disconnected) => break (None, wait(&mut child, patience)),
            Err(RecvTimeoutError::Timeout) => break (None, None),
        }
    };
    // A process that has answered has no more to say, and one in its driver may never end by itself.
    let _ = child.kill();
    let _ = wait(&mut child, Duration::from_secs(2));
    match (answer, ended) {
        (Some(answer), _) => Ok(answer),
        (None, Some(status)) => Err(failure(at, how(status), last_words(&said))),
        (None, None) => {
            Err(failure(at, format!("did not answer for {} s", patience.as_secs()), last_words(&said)))
        }
    }
}

/// The lines of an output, as they come.
fn lines(output: Option<impl Read + Send + 'static>) -> Receiver<String> {
    let (sender, lines) = channel();
    if let Some(output) = output {
        std::thread::spawn(move || {
            let mut output = BufReader::new(output.take(MOST_BYTES));
            let mut line = Vec::new();
            while output.read_until(b'\n', &mut line).is_ok_and(|read| read > 0) {
                let text = String::from_utf8_lossy(&line).trim().to_string();
                line.clear();
                if sender.send(text).is_err() {
                    return;
                }
            }
        });
    }
    lines
}

/// Waits for the end of a process; `None` where it does not come.
fn wait(child: &mut Child, most: Duration) -> Option<ExitStatus> {
    const STEP: Duration = Duration::from_millis(10);
    let mut waited = Duration::ZERO;
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return Some(status),
            Ok(None) if waited < most => std::thread::sleep(STEP),
            _ => return None,
        }
        waited += STEP;
    }
}

fn how(status: ExitStatus) -> String {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        let name = nix::sys::signal::Signal::try_from(signal).map_or("signal", |signal| signal.as_str());
        return format!("crashed ({name})");
    }
    format!("ended the program with code {}", status.code().unwrap_or(-1))
}

/// The last line with anything in it.
fn last_words(said: &Receiver<String>) -> String {
    let mut last = String::new();
    while let Ok(line) = said.recv_timeout(Duration::from_millis(200)) {
        if !line.is_empty() {
            last = line.chars().take(200).collect();
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Result<String, Failure> {
        run(Path::new("/bin/sh"), &["-c".into(), script.into()], Duration::from_secs(2))
    }

    #[test]
    fn answers_arrive_and_everything_else_is_told() {
        let answered = "echo noise; echo '@foveate stage building'; printf 'half a line'; echo; echo '@foveate answer 42'";
        assert_eq!(shell(answered), Ok("42".into()));
        assert_eq!(shell(&format!("{answered}; sleep 100")), Ok("42".into()));
        let ends = |script: &str| {
            let failure = shell(&format!("echo '@foveate stage building'; echo 'bad luck' >&2; {script}"));
            failure.unwrap_err().to_string()
        };
        assert_eq!(ends("kill -SEGV $$"), "its driver crashed (SIGSEGV) while building (it said: bad luck)");
        assert_eq!(
            ends("exit 8"),
            "its driver ended the program with code 8 while building (it said: bad luck)"
        );
        assert_eq!(
            ends("exit 0"),
            "its driver ended the program with code 0 while building (it said: bad luck)"
        );
        assert_eq!(
            ends("exec sleep 100"),
            "its driver did not answer for 2 s while building (it said: bad luck)"
        );
        // Output without end or line is no reason to wait, or to take memory.
        assert!(ends("yes noise").contains("while building"));
        assert!(ends("tr '\\0' x </dev/zero").contains("while building"));
        let nothing = run(Path::new("/nowhere"), &[], Duration::from_secs(1)).unwrap_err();
        assert!(nothing.to_string().contains("could not be tried"), "{nothing}");
    }
}
