// Included by build.rs: what a build was made from.

/// Has the program tell the commit that a release build was made from, and its date. Other builds are made again for
/// every change, and a new commit alone should not make them anew.
fn tell_version() {
    println!("cargo:rerun-if-env-changed=FOVEATE_COMMIT");
    let told = match std::env::var("PROFILE").as_deref() {
        Ok("release") => std::env::var("FOVEATE_COMMIT").ok().or_else(of_git).or_else(of_package),
        _ => Some("development build".to_string()),
    };
    println!("cargo:rustc-env=FOVEATE_BUILT_FROM={}", told.unwrap_or_else(|| "commit unknown".to_string()));
}

/// Commit and date of the checkout.
fn of_git() -> Option<String> {
    let git = |arguments: &[&str]| {
        let output = std::process::Command::new("git").args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_string())
    };
    // A package below somebody else's repository has a commit of its own.
    git(&["ls-files", "--error-unmatch", "build/version.rs"])?;
    let log = git(&["rev-parse", "--git-path", "logs/HEAD"])?;
    if std::path::Path::new(&log).exists() {
        println!("cargo:rerun-if-changed={log}");
    }
    let told = git(&["log", "-1", "--format=commit %h of %cs"])?;
    let changed = !git(&["status", "--porcelain", "--untracked-files=no"])?.is_empty();
    Some(if changed { format!("{told}, changed") } else { told })
}

/// The commit that cargo has noted in a package.
fn of_package() -> Option<String> {
    let text = std::fs::read_to_string(".cargo_vcs_info.json").ok()?;
    let commit = text.split("\"sha1\": \"").nth(1)?.get(..7)?;
    Some(format!("commit {commit}"))
}
