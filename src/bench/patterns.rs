//! Whether a device's kernels for patterns are built in this process: tried in one of their own first, since a driver may crash or
//! hang over them, and the verdict kept beside those of other kernels.

use std::path::Path;

use xxhash_rust::xxh3::Xxh3;

use super::choice::{keep_line, key, read_verdict};
use super::trial;
use crate::gpu::opencl::Device;
use crate::gpu::vulkan::Context;
use crate::isolated::{self, PATIENCE};
use crate::private_file::user_folder;
use crate::trace::pattern_maker::{NeighbourLists, Neighbours};
use crate::trace::source;

/// Whether a device makes patterns as it should, and finds neighbours where these are wanted.
///
/// # Errors
/// Why it does not.
pub fn tried(device: &Device, neighbours: Option<&(Context, NeighbourLists)>) -> Result<(), String> {
    let folder = user_folder().map(|folder| folder.join("traversals"));
    isolated::program().map_or(Ok(()), |program| tried_by(program, device, neighbours, folder.as_deref()))
}

fn tried_by(
    program: &Path,
    device: &Device,
    neighbours: Option<&(Context, NeighbourLists)>,
    folder: Option<&Path>,
) -> Result<(), String> {
    let path =
        folder.map(|folder| folder.join(format!("{:032x}.patterns", patterns_key(device, neighbours))));
    path.as_deref().and_then(read_verdict).unwrap_or_else(|| {
        let verdict = trial::patterns(program, device, neighbours, PATIENCE);
        let line = serde_json::to_string(&verdict).expect("text");
        // Without a place to keep it, it is tried again the next time.
        let _ = path.as_deref().map(|path| keep_line(path, &line));
        verdict
    })
}

/// What a trial depends on.
fn patterns_key(device: &Device, neighbours: Option<&(Context, NeighbourLists)>) -> u128 {
    let mut hash = Xxh3::new();
    hash.update(&key(device).to_le_bytes());
    // Groups follow from the device's kind.
    hash.update((source::pattern_text() + &source::pattern_options(0)).as_bytes());
    let found = neighbours.filter(|(context, _)| Neighbours::is_faster_on(device, context));
    if let Some((context, lists)) = found {
        let report = context.report();
        for text in [report.name.as_str(), &report.api_version] {
            hash.update(text.as_bytes());
            hash.update(&[0]);
        }
        hash.update(&report.driver_version.to_le_bytes());
        hash.update(&report.uuid);
        hash.update(&(lists.weights as u32).to_le_bytes());
        hash.update(source::neighbours_text(lists.of_pixel, lists.of_sample).as_bytes());
    }
    hash.digest128()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::trial::testing::{any_device, write_program};
    use std::fs;

    /// Programs that end as drivers make them: told, kept, and not asked again.
    #[test]
    fn a_driver_that_crashes_over_patterns_makes_none() {
        let Some(device) = any_device() else { return };
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("program");
        let ends_by = |ending: &str| {
            let stage = "echo '@foveate stage building the kernels of patterns'";
            write_program(&program, &format!("{stage}\n{ending}\n"));
        };
        let kept = folder.path().join("kept");
        ends_by("kill -SEGV $$");
        let crashed = "its driver crashed (SIGSEGV) while building the kernels of patterns".to_string();
        assert_eq!(tried_by(&program, &device, None, Some(&kept)), Err(crashed.clone()));
        ends_by("echo '@foveate answer {\"Ok\":null}'");
        assert_eq!(tried_by(&program, &device, None, Some(&kept)), Err(crashed), "as it was kept");
        assert_eq!(tried_by(&program, &device, None, None), Ok(()));
        fs::remove_dir_all(&kept).unwrap();
        assert_eq!(tried_by(&program, &device, None, Some(&kept)), Ok(()));
        ends_by("exit 9");
        assert_eq!(tried_by(&program, &device, None, Some(&kept)), Ok(()), "as it was kept");
    }
}
