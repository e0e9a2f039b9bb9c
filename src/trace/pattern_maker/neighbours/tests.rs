use super::*;
use crate::gpu::vulkan::testing::{self, fetch};
use crate::reference::reconstruct::WeightKind::{Gaussian, Inverse, Shepard};
use crate::reference::reconstruct::{nearest, weights};
use crate::trace::pattern_maker::testing::processor;

/// A processor that presents and one that traces in its memory, if there are such.
fn devices() -> Option<(Context, Device)> {
    let (context, device) = (testing::context()?, processor()?);
    if Neighbours::is_faster_on(&device, &context) {
        return Some((context, device));
    }
    println!("not run: the presenting device is no processor");
    None
}

/// What a finder makes of samples at these positions.
fn found(finder: &mut Finder, size: [u32; 2], samples: &[u32]) -> Option<Arc<Neighbours>> {
    let device = &finder.device.clone();
    let cells = Cells::new(size[0], size[1], samples).unwrap();
    // As if something lay before the cells.
    let starts = [&[7; 3], cells.starts.as_slice()].concat();
    let listed = SampleBuffers {
        size,
        count: samples.len(),
        samples: &Buffer::from_slice(device, samples).unwrap(),
        sorted: &Buffer::from_slice(device, &cells.sorted).unwrap(),
        starts: &Buffer::from_slice(device, &starts).unwrap(),
        first_start: 3,
        shift: cells.shift,
    };
    let found = finder.find(&listed).unwrap();
    device.finish().unwrap();
    found
}

fn check(finder: &mut Finder, size: [u32; 2], samples: &[u32]) {
    let lists = finder.lists;
    let found = found(finder, size, samples).expect("enough samples");
    let (context, [width, height]) = (&finder.context, size);
    let pixels = (width * height) as usize;
    let k = lists.of_pixel as usize;
    let [indices, shares] = found.of_pixels(pixels);
    let indices: Vec<u32> = fetch(context, &indices, pixels * k);
    let shares: Vec<f32> = fetch(context, &shares, pixels * k);
    let positions: Vec<[u32; 2]> = samples.iter().map(|&packed| [packed & 0xffff, packed >> 16]).collect();
    for pixel in 0..pixels {
        let at = [pixel as u32 % width, pixel as u32 / width];
        let expected = weights(&positions, at, k, lists.weights);
        for (j, &(sample, weight)) in expected.iter().enumerate() {
            let slot = j * pixels + pixel;
            assert_eq!(indices[slot] as usize, sample, "{at:?} neighbour {j} of {k}, {size:?}");
            let error = (f64::from(shares[slot]) - weight).abs();
            assert!(error < 2e-5, "{at:?} weight {j}: {} {weight}", shares[slot]);
        }
    }
    let Some(of_samples) = found.of_samples(samples.len()) else {
        assert!(lists.of_sample < 2);
        return;
    };
    let (count, m) = (samples.len(), lists.of_sample as usize);
    let of_samples: Vec<u32> = fetch(context, &of_samples, count * m);
    for (index, &at) in positions.iter().enumerate() {
        for (j, neighbour) in nearest(&positions, at, m).iter().enumerate() {
            assert_eq!(of_samples[j * count + index] as usize, neighbour.sample, "sample {index}, {j}");
        }
    }
    assert!(found.are_right(size, samples));
}

/// So many positions in a part of a view.
fn scattered(count: u32, low: [u32; 2], size: [u32; 2]) -> Vec<u32> {
    let hash = |i: u32| {
        let i = i.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995;
        (i ^ i >> 15).wrapping_mul(0x85eb_ca6b) >> 7
    };
    (0..count)
        .map(|i| (low[0] + hash(2 * i) % size[0]) | (low[1] + hash(2 * i + 1) % size[1]) << 16)
        .collect()
}

#[test]
fn neighbours_are_those_of_the_reference() {
    let Some((context, device)) = devices() else { return };
    let mut clustered = scattered(150, [3, 4], [12, 9]);
    clustered.push(66 | 44 << 16);
    let cases = [
        ([67, 45], scattered(200, [0, 0], [67, 45])),
        ([67, 45], clustered),
        ([64, 48], scattered(900, [0, 0], [64, 48])),
        ([33, 70], scattered(31, [0, 0], [33, 70])),
        // Farther than narrow keys reach, and two samples at one place.
        (
            [700, 9],
            [scattered(20, [0, 0], [40, 9]), vec![690 | 3 << 16, 690 | 3 << 16, 350, 600, 5]].concat(),
        ),
        ([3, 200], scattered(26, [0, 0], [3, 200])),
    ];
    for (of_pixel, of_sample, weights) in
        [(4, 24, Shepard), (1, 1, Gaussian), (7, 3, Inverse), (16, 24, Gaussian)]
    {
        let mut finder =
            Finder::new(&device, &context, NeighbourLists { of_pixel, of_sample, weights }).unwrap();
        for (size, samples) in &cases {
            check(&mut finder, *size, samples);
        }
    }
    testing::assert_valid(&context);
}

/// Small views have room for all, as large ones do.
#[test]
fn there_is_room_for_views_of_any_size() {
    let Some((context, device)) = devices() else { return };
    let lists = NeighbourLists { of_pixel: 4, of_sample: 1, weights: Shepard };
    for count in (1..40).chain([1000, 4001]) {
        assert!(
            Neighbours::new(&device, &context, lists, count, count).unwrap().fits(count, count),
            "{count}"
        );
    }
    let mut finder = Finder::new(&device, &context, lists).unwrap();
    check(&mut finder, [7, 1], &[0, 1, 2, 4, 6]);
}

#[test]
fn lists_longer_than_there_are_samples_are_left_to_the_presenting_device() {
    let Some((context, device)) = devices() else { return };
    let lists = NeighbourLists { of_pixel: 4, of_sample: 24, weights: Shepard };
    let mut finder = Finder::new(&device, &context, lists).unwrap();
    let samples = scattered(25, [0, 0], [60, 40]);
    assert!(found(&mut finder, [60, 40], &samples[..24]).is_none());
    assert!(found(&mut finder, [60, 40], &samples).is_some());
}

/// What somebody keeps stays as it is; what nobody keeps is used again.
#[test]
fn memory_is_used_again_when_nobody_keeps_it() {
    let Some((context, device)) = devices() else { return };
    let lists = NeighbourLists { of_pixel: 4, of_sample: 24, weights: Shepard };
    let mut finder = Finder::new(&device, &context, lists).unwrap();
    let (size, pixels) = ([60, 40], 2400);
    let sets = [11, 12, 13].map(|left| scattered(300, [0, 0], [60 - left, 40]));
    let first = found(&mut finder, size, &sets[0]).unwrap();
    let before: Vec<u32> = fetch(&context, &first.of_pixels(pixels)[0], 4 * pixels);
    let second = found(&mut finder, size, &sets[1]).unwrap();
    assert!(!Arc::ptr_eq(&first, &second));
    assert_eq!(before, fetch::<u32>(&context, &first.of_pixels(pixels)[0], 4 * pixels));
    let address = Arc::as_ptr(&first);
    drop(first);
    let third = found(&mut finder, size, &sets[2]).unwrap();
    assert_eq!(Arc::as_ptr(&third), address);
    // A larger view has memory of its own, and what is too small for it is given up.
    drop(third);
    let larger = found(&mut finder, [120, 80], &scattered(1200, [0, 0], [120, 80])).unwrap();
    assert_eq!(
        (finder.kept.len(), larger.are_right([120, 80], &scattered(1200, [0, 0], [120, 80]))),
        (2, true)
    );
}
