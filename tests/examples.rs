//! The examples do what they say.

use std::path::Path;

use foveate::scene::generate::demo;

mod common;

#[allow(dead_code)]
#[path = "../examples/own_device.rs"]
mod own_device;

#[test]
fn a_renderer_works_on_an_applications_own_device() {
    if common::vulkan().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = (folder.path().join("demo.glb"), folder.path().join("picture.png"));
    std::fs::write(&scene, demo::generate()).unwrap();
    own_device::run(&scene, &out).unwrap();
    let picture = image::open(&out).unwrap().into_rgb8();
    assert_eq!(picture.dimensions(), (320, 200));
    // Sky above, a courtyard below: neither black nor of one colour.
    let mean = |rows: std::ops::Range<u32>| {
        let pixels = rows.len() as u32 * 320;
        let sum: u32 = rows
            .flat_map(|y| (0..320).map(move |x| (x, y)))
            .map(|(x, y)| u32::from(picture[(x, y)][2]))
            .sum();
        sum / pixels
    };
    let (above, below) = (mean(0..40), mean(160..200));
    assert!(above > 40 && below > 10 && above.abs_diff(below) > 10, "{above} {below}");
    assert!(own_device::run(Path::new("no such scene.glb"), &out).is_err());
}
