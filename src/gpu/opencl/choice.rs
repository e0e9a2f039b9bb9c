//! Which of a machine's OpenCL devices trace.

use super::{DeviceInfo, why_none};
use crate::error::{Error, Result};

/// The OpenCL devices to trace with, by their indices: those asked for, else all usable ones, each once where
/// two drivers offer it. The best one is first; among equals it is the device that presents, since its
/// memory can be shared.
pub fn choose(devices: &[DeviceInfo], wanted: &str, presenting: &[u8; 16]) -> Result<Vec<usize>> {
    let missing = |problem: String| Err(Error::NoDevice { kind: "OpenCL", problem });
    if devices.is_empty() {
        return missing(why_none());
    }
    let presenting: String = presenting.iter().map(|byte| format!("{byte:02x}")).collect();
    let rank = |&index: &usize| {
        let d = &devices[index];
        let kind = ["gpu", "cpu", "accelerator"].iter().position(|k| *k == d.kind);
        (kind, d.uuid.as_deref() != Some(&presenting), std::cmp::Reverse(d.compute_units))
    };
    let mut chosen: Vec<usize> = Vec::new();
    if wanted.trim().is_empty() {
        chosen.extend((0..devices.len()).filter(|&index| devices[index].unusable.is_none()));
        chosen.sort_by_key(rank);
        let mut seen = std::collections::BTreeSet::new();
        chosen.retain(|&index| devices[index].uuid.as_ref().is_none_or(|uuid| seen.insert(uuid.clone())));
        if chosen.is_empty() {
            return missing("none of those installed can be used; `foveate devices` tells why".into());
        }
        return Ok(chosen);
    }
    for name in wanted.split(',').map(str::trim).filter(|name| !name.is_empty()) {
        match find(devices, name) {
            Some(index) if !chosen.contains(&index) => chosen.push(index),
            Some(_) => {}
            None => return missing(format!("none is called {name:?}; `foveate devices` lists them")),
        }
    }
    if chosen.is_empty() {
        return missing(format!("{wanted:?} names none; `foveate devices` lists them"));
    }
    chosen.sort_by_key(rank);
    Ok(chosen)
}

/// A device by its number, its UUID or a part of its name.
fn find(devices: &[DeviceInfo], name: &str) -> Option<usize> {
    // A number beyond the last is not a part of a name.
    if name.len() <= 2 && name.bytes().all(|byte| byte.is_ascii_digit()) {
        return name.parse().ok().filter(|&index: &usize| index < devices.len());
    }
    let lower = name.to_lowercase();
    let plain: String = lower.chars().filter(|c| *c != '-').collect();
    let by_uuid = || devices.iter().position(|d| d.uuid.as_deref() == Some(&plain));
    let by_name = || devices.iter().position(|d| d.name.to_lowercase().contains(&lower));
    by_uuid().or_else(by_name)
}
