//! `foveate bench`.

use super::*;

const FEW: &str =
    "--repetitions 2 --width 64 --height 48 --samples 200 --position 0.2,1.5,5 --look-at 0,0.9,0";

#[test]
fn bench_measures_every_kind_of_ray() {
    let folder = folder();
    let told = foveate(folder.path(), &format!("bench scene.glb --json --cold {FEW}")).succeeds().json();
    assert_eq!((&told["triangles"], &told["bvh"]["depth"]), (&json!(8), &json!(1)));
    assert!(told["bvh"]["refit_ms"].as_f64().unwrap() > 0.0, "{told}");
    let devices = told["devices"].as_array().unwrap();
    assert!(!devices.is_empty(), "{told}");
    assert_eq!(devices.len() % 2, 0, "two variants on each: {told}");
    for device in devices {
        assert!(device["bytes_per_triangle"].as_f64().unwrap() > 52.0, "{device}");
        for key in ["cold_ms", "warm_ms", "launch_ms"] {
            assert!(device["kernels"][key].as_f64().unwrap() > 0.0, "{key} of {device}");
        }
        let rays = device["rays"].as_array().unwrap();
        let of = |kind: &str| {
            rays.iter().find(|row| row["kind"] == kind).unwrap_or_else(|| panic!("{kind}: {device}"))
        };
        assert_eq!((&of("pixels")["rays"], &of("samples")["rays"]), (&json!(64 * 48), &json!(200)));
        let bundles = told["view"]["bundles"].as_u64().unwrap();
        assert!(bundles > 100, "{told}");
        for kind in ["occlusion", "bounce"] {
            assert_eq!(of(kind)["rays"], json!(bundles * 32));
        }
        for row in rays {
            let (rays, ms) = (row["rays"].as_f64().unwrap(), row["ms"].as_f64().unwrap());
            let rate = row["mrays_per_second"].as_f64().unwrap();
            assert!((rate * ms / rays * 1e3 - 1.0).abs() < 1e-9, "{row}");
            assert!(
                row["ms_p10"].as_f64() <= row["ms"].as_f64() && row["ms"].as_f64() <= row["ms_p90"].as_f64()
            );
        }
    }
    let text = foveate(folder.path(), &format!("bench scene.glb {FEW}")).succeeds().out;
    for part in
        ["dense primary", "foveated primary", "32 occlusion", "32 bounce", "Mrays/s", "bytes a triangle"]
    {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn exported_rays_are_whole() {
    let folder = folder();
    let arguments = format!("bench scene.glb --export rays.bin {FEW}");
    foveate(folder.path(), &arguments).succeeds();
    let bytes = std::fs::read(folder.path().join("rays.bin")).unwrap();
    assert_eq!(&bytes[..8], b"FVRAYS01");
    let counts: Vec<usize> =
        bytes[8..28].chunks(4).map(|b| u32::from_le_bytes(b.try_into().unwrap()) as usize).collect();
    let [vertices, triangles, pixels, samples, bundles] = counts[..] else { panic!("{counts:?}") };
    assert_eq!((triangles, pixels, samples), (8, 64 * 48, 200));
    assert!(bundles > 100 && bundles <= samples);
    let words = 3 + 3 * (vertices + triangles + pixels + samples + bundles + 32 * bundles);
    assert_eq!(bytes.len(), 28 + 4 * (words + pixels + samples + bundles + 32 * bundles));
}

#[test]
fn bench_refuses_what_it_cannot_do() {
    let folder = folder();
    let run = foveate(folder.path(), &format!("bench scene.glb --export none/rays.bin {FEW}"));
    assert!(run.sentence().contains("its folder does not exist"), "{run:?}");
    let run = foveate(folder.path(), "bench gone.glb");
    assert!(run.sentence().contains("there is no such file"), "{run:?}");
    let run = foveate(folder.path(), &format!("bench scene.glb --device nothing {FEW}"));
    assert!(run.sentence().contains("none is called"), "{run:?}");
    assert_eq!(foveate(folder.path(), "bench scene.glb --repetitions 0").code, Some(2));
}
