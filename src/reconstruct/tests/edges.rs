//! Light at edges, on slanted floors and on thin things.

use super::*;

#[test]
fn light_does_not_leak_over_edges() {
    let Some(context) = testing::context() else { return };
    let size = (64, 40);
    let mut bench = Bench::new(&context, Mode::default(), size, scattered(300, size.0, size.1));
    let (facing, upward) = (normal(&bench.view, TOWARD), normal(&bench.view, [0.0, 1.0, 0.0]));
    let light = |x: u32| if x < 32 { 1.0 } else { 100.0 };
    // An edge in depth, then one in normals.
    for edge in ["depth", "normal"] {
        let depth = |x: u32| if edge == "depth" && x < 32 { 3.0 } else { 9.0 };
        let facing = |x: u32| if edge == "normal" && x < 32 { upward } else { facing };
        let picture = bench.render(
            |x, _| SampleRecord {
                first: [light(x); 3],
                depth: depth(x),
                second: [0.0; 3],
                normal: facing(x),
                ..SampleRecord::default()
            },
            |x, _| seen(facing(x), depth(x), [1.0; 3], 0.0),
        );
        // Pixels with a sample of their own surface among the nearest; others borrow, by design.
        let good = |&(index, pixel): &(usize, &[f32; 4])| {
            let expected = light(index as u32 % size.0);
            (pixel[0] - expected).abs() < 0.02 * expected
        };
        let kept = picture.iter().enumerate().filter(good).count();
        assert!(kept as f64 > 0.985 * picture.len() as f64, "{edge}: {kept} of {}", picture.len());
    }
    // Without the edge in the records the light must leak: the count above can fail.
    let picture = bench.render(
        |x, _| SampleRecord {
            first: [light(x); 3],
            depth: 9.0,
            second: [0.0; 3],
            normal: facing,
            ..SampleRecord::default()
        },
        |_, _| seen(facing, 9.0, [1.0; 3], 0.0),
    );
    let between = picture.iter().filter(|pixel| (3.0..97.0).contains(&pixel[0])).count();
    assert!(between > 100, "{between}");
    testing::assert_valid(&context);
}

#[test]
fn edges_show_their_share_of_a_neighbour() {
    let Some(context) = testing::context() else { return };
    let size = (5, 4);
    let mut bench = Bench::new(&context, Mode::default(), size, vec![0]);
    let brightness = |x: u32, y: u32| ((y * 5 + x) * 8) as f32;
    // Pixel (2, 1) shares 6 fifteenths with each of its neighbours in turn.
    for neighbour in 0..8 {
        let picture = bench.render(
            |_, _| SampleRecord::default(),
            |x, y| VisibilityRecord {
                normal: if (x, y) == (2, 1) { neighbour << 24 | 6 << 27 } else { 0 },
                emission: pack_emission([brightness(x, y); 3]),
                ..VisibilityRecord::default()
            },
        );
        let place = neighbour + u32::from(neighbour > 3);
        let mixed = 0.6 * brightness(2, 1) + 0.4 * brightness(1 + place % 3, place / 3);
        for (index, &pixel) in picture.iter().enumerate() {
            let (x, y) = (index as u32 % 5, index as u32 / 5);
            let expected = if (x, y) == (2, 1) { mixed } else { brightness(x, y) };
            assert_close(pixel, [expected; 3], 1e-5, (neighbour, x, y));
        }
    }
    testing::assert_valid(&context);
}

#[test]
fn a_slanted_floor_is_one_surface() {
    let Some(context) = testing::context() else { return };
    let size = (48, 48);
    let mut bench = Bench::new(&context, Mode::default(), size, scattered(200, size.0, size.1));
    let up = [0.0, 1.0, 0.0];
    let floor = normal(&bench.view, up);
    let eye = bench.view;
    // Depth of a floor 1.5 m below the eye.
    let depth = move |x: u32, y: u32| {
        let toward = eye.eye_direction(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        if toward.y < -0.02 { (-1.5 / toward.y) as f32 } else { 0.0 }
    };
    let checker = |x: u32, y: u32| ((x + y) % 2) as f32;
    let picture = bench.render(
        |x, y| SampleRecord {
            first: [checker(x, y); 3],
            depth: depth(x, y),
            second: [0.0; 3],
            normal: floor,
            ..SampleRecord::default()
        },
        |x, y| seen(floor, depth(x, y), [1.0; 3], 0.0),
    );
    // The filter averages a checkerboard's light over the whole floor, up to chance.
    let floor: Vec<f32> =
        (0..48 * 48).filter(|&p| depth(p % 48, p / 48) > 0.0).map(|p| picture[p as usize][0]).collect();
    let mean = floor.iter().sum::<f32>() / floor.len() as f32;
    let deviation = (floor.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / floor.len() as f32).sqrt();
    assert!((0.35..0.65).contains(&mean) && deviation < 0.2, "mean {mean}, deviation {deviation}");
    testing::assert_valid(&context);
}

#[test]
fn a_thin_thing_without_samples_takes_its_neighbours_light() {
    let Some(context) = testing::context() else { return };
    let size = (32, 32);
    let samples = scattered(80, size.0, size.1);
    let mut bench = Bench::new(&context, Mode::default(), size, samples);
    let (facing, sideways) = (normal(&bench.view, TOWARD), normal(&bench.view, [1.0, 0.0, 0.0]));
    // A wire before a wall, then before the background: no sample hits the wire.
    for wall in [8.0, 0.0] {
        let record = |x: u32, _: u32| SampleRecord {
            first: if wall > 0.0 || x > 20 { [3.0; 3] } else { [f32::MAX; 3] },
            depth: if x > 20 { 8.0 } else { wall },
            second: [0.0; 3],
            normal: facing,
            ..SampleRecord::default()
        };
        let picture = bench.render(record, |x, _| match x {
            15 => seen(sideways, 2.0, [1.0; 3], 0.0),
            _ => VisibilityRecord { emission: pack_emission([0.5; 3]), ..seen(facing, wall, [1.0; 3], 0.0) },
        });
        for y in 0..32 {
            let wire = picture[y * 32 + 15];
            assert!(wall == 0.0 || (wire[0] - 3.0).abs() < 1e-3, "{wire:?}");
            assert!(wire.iter().all(|value| value.is_finite() && *value < 4.0), "{wire:?}");
            if wall == 0.0 {
                assert_close(picture[y * 32 + 3], [0.5; 3], 1e-2, y);
            }
        }
    }
    testing::assert_valid(&context);
}
