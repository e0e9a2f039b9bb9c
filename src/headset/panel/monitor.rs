//! Which monitor is the headset's panel.

use std::path::Path;

/// Bytes of an EDID that tell its maker and product: "OVR" as three packed letters, and 1.
const RIFT_DK1: [u8; 4] = [0x3e, 0xd2, 0x01, 0x00];
/// Where Linux lists connectors with their EDIDs.
pub const CONNECTORS: &str = "/sys/class/drm";

/// What a window system tells of a monitor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Monitor {
    /// Its name, often the connector's, such as HDMI-A-1.
    pub name: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Whether the user has made it the main one.
    pub primary: bool,
}

/// The monitor that is a panel of that many pixels. `connectors` are those with a DK1's EDID: where the
/// window system's names lead to none of them, any monitor of the panel's size will do, as long as it is
/// neither the only nor the main one.
pub fn panel_among(monitors: &[Monitor], pixels: [u32; 2], connectors: &[String]) -> Option<usize> {
    let named = |monitor: &Monitor| {
        connectors.iter().any(|connector| connector_key(connector) == connector_key(&monitor.name))
    };
    let fits = |monitor: &&Monitor| monitor.size == pixels;
    let position = |wanted: &dyn Fn(&&Monitor) -> bool| monitors.iter().position(|m| wanted(&m));
    position(&|m| fits(m) && named(m)).or_else(|| {
        let spare = monitors.len() > 1;
        position(&|m| spare && fits(m) && !m.primary)
    })
}

/// A connector's kind and number; "HDMI-A-1" and "HDMI-1" are the same.
fn connector_key(name: &str) -> String {
    name.to_ascii_uppercase().replace("HDMI-A-", "HDMI-").replace("DVI-D-", "DVI-").replace("DVI-I-", "DVI-")
}

/// Names of the connectors below a folder such as [`CONNECTORS`] to which a DK1's panel is connected.
pub fn rift_connectors(folder: &Path) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let entries = entries.flatten().filter(|entry| {
        let edid = std::fs::read(entry.path().join("edid")).unwrap_or_default();
        edid.get(8..12) == Some(&RIFT_DK1)
    });
    // "card0-HDMI-A-1" is the connector HDMI-A-1.
    let name = |entry: std::fs::DirEntry| {
        let name = entry.file_name().into_string().ok()?;
        Some(name.split_once('-')?.1.to_string())
    };
    entries.filter_map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn monitor(name: &str, size: [u32; 2], primary: bool) -> Monitor {
        Monitor { name: name.to_string(), size, primary }
    }

    #[test]
    fn the_panel_is_known_by_its_connector_or_its_size() {
        let pixels = [1280, 800];
        let desk = monitor("eDP-1", [1920, 1080], true);
        let small = monitor("eDP-1", pixels, true);
        let rift = monitor("HDMI-1", pixels, false);
        let other = monitor("DP-2", pixels, false);
        let among = |monitors: &[&Monitor], connectors: &[&str]| {
            let monitors: Vec<_> = monitors.iter().map(|&m| m.clone()).collect();
            let connectors: Vec<_> = connectors.iter().map(|c| c.to_string()).collect();
            panel_among(&monitors, pixels, &connectors)
        };
        assert_eq!(among(&[&desk, &other, &rift], &["HDMI-A-1"]), Some(2));
        assert_eq!(among(&[&desk, &rift], &[]), Some(1));
        assert_eq!(among(&[&small, &rift], &[]), Some(1));
        assert_eq!(among(&[&rift], &["HDMI-A-1"]), Some(0));
        assert_eq!(among(&[&rift], &[]), None);
        assert_eq!(among(&[&small], &[]), None);
        assert_eq!(among(&[&desk, &monitor("HDMI-1", [640, 480], false)], &["HDMI-A-1"]), None);
        assert_eq!(among(&[], &["HDMI-A-1"]), None);
    }

    #[test]
    fn connectors_are_read_and_nonsense_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, edid: &[u8]| {
            std::fs::create_dir_all(folder.path().join(name)).unwrap();
            std::fs::write(folder.path().join(name).join("edid"), edid).unwrap();
        };
        let mut edid = [0u8; 128];
        edid[8..12].copy_from_slice(&RIFT_DK1);
        write("card0-HDMI-A-1", &edid);
        write("card0-DP-1", &[0; 128]);
        write("card0-DP-2", &[]);
        write("version", &edid);
        assert_eq!(rift_connectors(folder.path()), ["HDMI-A-1"]);
        assert!(rift_connectors(&folder.path().join("none")).is_empty());
    }
}
