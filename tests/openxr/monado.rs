//! A Monado service of one's own, with a simulated headset and nobody else's clients.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// What the loader reads to find Monado, below the root or below the folder of unpacked drivers.
const MANIFEST: &str = "usr/share/openxr/1/openxr_monado.json";
/// How long the service may take to start.
const PATIENCE: Duration = Duration::from_secs(60);

/// Monado's service, in a runtime folder of its own. Ends with this.
pub struct Monado {
    service: Child,
    folder: PathBuf,
    settings: Vec<(&'static str, String)>,
}

/// The manifest and the service: what is unpacked for these tests (`scripts/unpack-drivers.sh`), else the system's.
fn places() -> (PathBuf, PathBuf) {
    let unpacked = std::env::var_os("FOVEATE_DRIVERS").map(PathBuf::from);
    match unpacked.filter(|folder| folder.join(MANIFEST).exists()) {
        Some(folder) => (folder.join(MANIFEST), folder.join("bin/monado-service")),
        None => (Path::new("/").join(MANIFEST), "monado-service".into()),
    }
}

/// Whether Monado is installed; says so where it is not. Where CI=true promises it, that is a failure.
pub fn installed() -> bool {
    let (manifest, service) = places();
    let there = manifest.exists()
        && Command::new(service).arg("--help").stdout(Stdio::null()).stderr(Stdio::null()).spawn().is_ok_and(
            |mut child| {
                let _ = child.kill();
                child.wait().is_ok()
            },
        );
    if !there {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "Monado is not installed");
        println!("not run: Monado is not installed (scripts/install-packages.sh test)");
    }
    there
}

impl Monado {
    /// Starts the service with these environment variables in a folder that exists.
    pub fn start(folder: &Path, settings: &[(&'static str, String)]) -> Monado {
        let mut settings = settings.to_vec();
        settings.push(("XRT_NO_STDIN", "1".to_string()));
        Monado::start_bare(folder, &settings)
    }

    /// The same with nothing added.
    pub fn start_bare(folder: &Path, settings: &[(&'static str, String)]) -> Monado {
        let settings = settings.to_vec();
        let service = launch(folder, &settings);
        let monado = Monado { service, folder: folder.to_path_buf(), settings };
        monado.wait_for_start();
        monado
    }

    /// Starts it with the simulated headset and a compositor that shows nothing, at 20 Hz.
    pub fn start_null(folder: &Path) -> Monado {
        let settings = [("SIMULATED_ENABLE", "1"), ("XRT_COMPOSITOR_NULL", "1"), ("IPC_LOG", "trace")];
        Monado::start(folder, &settings.map(|(name, value)| (name, value.to_string())))
    }

    /// Ends the service as a crash would.
    pub fn kill(&mut self) {
        let _ = self.service.kill();
        let _ = self.service.wait();
        let _ = std::fs::remove_file(self.folder.join("monado_comp_ipc"));
    }

    /// Starts it again after [`Monado::kill`].
    pub fn restart(&mut self) {
        self.service = launch(&self.folder, &self.settings);
        self.wait_for_start();
    }

    /// Makes a program a client of this service.
    pub fn serve(&self, client: &mut Command) {
        client.env("XR_RUNTIME_JSON", places().0).env("XDG_RUNTIME_DIR", &self.folder);
        // Whatever the runtime and its loader have to say comes between this program's own words.
        client.env("XRT_LOG", "error").env("XR_LOADER_DEBUG", "none");
        client.env("OXR_DEBUG_ENTRYPOINTS", "0");
    }

    /// What the service has said so far.
    pub fn log(&self) -> String {
        std::fs::read_to_string(self.folder.join("log")).unwrap_or_default()
    }

    /// How often clients have asked the service for something, of those asked with IPC_LOG=trace.
    pub fn calls(&self, name: &str) -> usize {
        let end = format!("Dispatching {name}");
        self.log().lines().filter(|line| line.ends_with(&end)).count()
    }

    fn wait_for_start(&self) {
        let start = Instant::now();
        while !self.log().contains("The Monado service has started") {
            assert!(start.elapsed() < PATIENCE, "{}", self.log());
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Drop for Monado {
    fn drop(&mut self) {
        let _ = self.service.kill();
        let _ = self.service.wait();
    }
}

fn launch(folder: &Path, settings: &[(&'static str, String)]) -> Child {
    let log = std::fs::File::create(folder.join("log")).unwrap();
    Command::new(places().1)
        .env("XDG_RUNTIME_DIR", folder)
        .envs(settings.iter().map(|(name, value)| (name, value)))
        .stdin(Stdio::null())
        .stdout(log.try_clone().unwrap())
        .stderr(log)
        .spawn()
        .unwrap()
}
