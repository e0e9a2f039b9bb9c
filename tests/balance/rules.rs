//! What holds whatever the balancer is told.

use foveate::foveation::{ALIGNMENT, Part, Workload};
use foveate::frame::balance::{Balancer, Observation, Slice};
use proptest::prelude::*;

fn parts_cover(workload: &Workload, whole: &Part, parts: &[(usize, Part)]) -> Result<(), TestCaseError> {
    let mut sample = whole.samples.start;
    let mut tile = whole.tiles.start;
    for (_, part) in parts {
        prop_assert_eq!((part.samples.start, part.tiles.start), (sample, tile));
        prop_assert!(part.samples.end >= sample && part.tiles.end >= tile);
        prop_assert!(part.first_traced <= part.tiles.start);
        prop_assert!(part.samples.start % ALIGNMENT == 0 || part.samples.start == whole.samples.end);
        // Every sample lies in a tile that its part traces.
        if part.samples.end > part.samples.start {
            prop_assert!(workload.tile_of(part.samples.start) >= part.first_traced);
            prop_assert!(workload.tile_of(part.samples.end - 1) < part.tiles.end);
        }
        (sample, tile) = (part.samples.end, part.tiles.end);
    }
    prop_assert_eq!((sample, tile), (whole.samples.end, whole.tiles.end));
    Ok(())
}

/// Times of all kinds, among them none at all and what is not a number.
fn times() -> impl Strategy<Value = f64> {
    prop_oneof![
        5 => 1e-6..1e4f64,
        1 => Just(0.0),
        1 => Just(-1.0),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(f64::MIN_POSITIVE),
        1 => Just(f64::MAX),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, ..ProptestConfig::default() })]

    #[test]
    fn parts_cover_a_view_whatever_was_measured(
        counts in prop::collection::vec(0u32..257, 0..300),
        dense in any::<bool>(),
        devices in 1usize..17,
        frames in prop::collection::vec(prop::collection::vec((times(), times(), 0.0..1f32, any::<bool>()), 16), 0..12),
    ) {
        let workload = Workload::of_counts(&counts, dense);
        let mut balancer = Balancer::new(devices);
        for frame in &frames {
            let parts = balancer.split(0, &workload);
            prop_assert!(!parts.is_empty());
            parts_cover(&workload, &workload.whole(), &parts)?;
            let observed: Vec<Observation> = parts
                .iter()
                .map(|(device, part)| {
                    let (pixels_ms, samples_ms, ..) = frame[*device];
                    let slices = workload.slices(part, 3);
                    let slices = slices.into_iter().map(|part| Slice { part, pixels_ms, samples_ms });
                    Observation { device: *device, slices: slices.collect(), overhead_ms: 0.0 }
                })
                .collect();
            let seen: Vec<f32> = (0..counts.len()).map(|tile| frame[tile % 16].2).collect();
            balancer.observe(0, &workload, &seen, &observed);
            // What one device leaves is split over the others.
            if devices > 1 && parts.len() > 1 {
                let (lost, part) = parts[0].clone();
                balancer.set_present(lost, false);
                let again = balancer.split_part(0, &workload, part.clone());
                prop_assert!(again.iter().all(|(device, _)| *device != lost));
                parts_cover(&workload, &part, &again)?;
                balancer.set_present(lost, frame[lost].3);
            }
            if balancer.split(0, &workload).is_empty() {
                (0..devices).for_each(|device| balancer.set_present(device, true));
            }
            let powers = balancer.powers();
            prop_assert!(powers.iter().all(|p| p.is_finite() && (0.0..=1.0).contains(p)), "{:?}", powers);
        }
    }

    #[test]
    fn slices_cover_their_part(counts in prop::collection::vec(0u32..100, 1..50), count in 1u32..9) {
        let workload = Workload::of_counts(&counts, true);
        let slices = workload.slices(&workload.whole(), count);
        prop_assert!(!slices.is_empty() && slices.len() <= count as usize);
        let numbered: Vec<(usize, Part)> = slices.into_iter().enumerate().collect();
        parts_cover(&workload, &workload.whole(), &numbered)?;
    }
}

/// A device that is far too slow for its smallest part is asked now and then, so that it can come back.
#[test]
fn hopeless_devices_are_asked_again() {
    let workload = Workload::of_counts(&[100; 400], false);
    let mut balancer = Balancer::new(2);
    let mut asked = 0;
    for frame in 0..200 {
        let parts = balancer.split(0, &workload);
        let observed: Vec<Observation> = parts
            .iter()
            .map(|(device, part)| {
                let samples = f64::from(part.samples.end - part.samples.start);
                let samples_ms = samples * if *device == 0 { 1e-3 } else { 1e3 };
                Observation {
                    device: *device,
                    slices: vec![Slice { part: part.clone(), pixels_ms: 0.0, samples_ms }],
                    overhead_ms: 0.0,
                }
            })
            .collect();
        balancer.observe(0, &workload, &[], &observed);
        asked += usize::from(frame >= 100 && parts.len() == 2);
    }
    assert!((1..10).contains(&asked), "{asked}");
}
