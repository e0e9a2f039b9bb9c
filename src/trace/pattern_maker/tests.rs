use super::*;
use crate::foveation::spaced;
use crate::math::pose::Pose;
use crate::math::view::FieldOfView;

fn maker() -> Option<PatternMaker> {
    Some(PatternMaker::new(&testing::processor()?).unwrap())
}

fn view(width: u32, height: u32) -> View {
    let fov = FieldOfView { left: -1.4, right: 1.1, up: 0.9, down: -0.8 };
    View { world_from_eye: Pose::IDENTITY, fov, width, height, spacing: Default::default() }
}

/// Holds a device's pattern and cells to those of the host.
fn check(maker: &mut PatternMaker, wanted: &PatternRequest) {
    let case = format!("{} {} {:?} {}", wanted.law, wanted.gaze, wanted.view, wanted.count);
    let (pattern, tables) = maker.choose(wanted).unwrap();
    let PatternTables::Cells(cells) = tables else { panic!("{case}: neighbours, which were not asked for") };
    let expected = wanted.on_host();
    assert!(pattern == expected, "{case}");
    let listed = pattern.samples.len();
    assert_eq!((cells.sorted.len(), cells.starts.last()), (listed, Some(&(listed as u32))), "{case}");
    let mut seen = vec![false; listed];
    for (cell, range) in (0..).zip(cells.starts.windows(2)) {
        for &[packed, index] in &cells.sorted[range[0] as usize..range[1] as usize] {
            let (x, y) = ((packed & 0xffff) >> cells.shift, (packed >> 16) >> cells.shift);
            assert_eq!(cell, y * cells.across + x, "{case}");
            assert_eq!(packed, pattern.samples[index as usize], "{case}");
            assert!(!std::mem::replace(&mut seen[index as usize], true), "{case}");
        }
    }
}

const LAWS: [&str; 5] = ["paper", "linear-mar", "log-polar", "uniform", "full"];

#[test]
fn patterns_are_those_of_the_host() {
    let Some(mut maker) = maker() else { return };
    let gazes = [DVec2::splat(0.5), DVec2::new(0.13, 0.9), DVec2::new(-3.0, 1.2), DVec2::NAN];
    for (width, height, count) in
        [(640, 400, 14_000), (301, 217, 900), (17, 33, 40), (1, 1, 1), (700, 3, 2099)]
    {
        let view = view(width, height);
        for (law, gaze) in LAWS.iter().flat_map(|law| gazes.map(|gaze| (law.parse().unwrap(), gaze))) {
            let wanted = PatternRequest { view, law, gaze, count, hidden: None, lens: None };
            check(&mut maker, &wanted);
        }
    }
}

#[test]
fn patterns_of_uneven_pixels_are_those_of_the_host() {
    let Some(mut maker) = maker() else { return };
    for (gaze, law) in [(0.5, "paper"), (0.2, "linear-mar"), (0.9, "log-polar")] {
        let (gaze, law) = (DVec2::new(gaze, 0.6), law.parse().unwrap());
        let view = spaced(&view(1280, 800), gaze, 0.022, 1.0);
        assert!(!view.spacing.is_even());
        let wanted = PatternRequest { view, law, gaze, count: 30_000, hidden: None, lens: None };
        check(&mut maker, &wanted);
        let hidden = BitMask::from_fn(1280, 800, |x, y| (x / 7 + y / 5) % 3 == 0);
        check(&mut maker, &PatternRequest { hidden: Some(Arc::new(hidden)), ..wanted });
    }
}

#[test]
fn hidden_pixels_and_lenses_count_as_on_the_host() {
    let Some(mut maker) = maker() else { return };
    let view = view(333, 250);
    let hidden = Arc::new(BitMask::from_fn(333, 250, |x, y| x * x + y * y < 30_000 || x > 300));
    let all = Arc::new(BitMask::from_fn(333, 250, |_, _| true));
    let visible = view.pixels() - hidden.count();
    let lens =
        Lens::new(DVec2::new(150.0, 120.0), 400.0, |r| (r / (1.0 + r / 200.0), (1.0 + r / 200.0).powi(-2)));
    let lens = Arc::new(lens);
    let gaze = DVec2::new(0.4, 0.55);
    for law in LAWS.map(|law| law.parse().unwrap()) {
        let wanted = PatternRequest { view, law, gaze, count: 5000, hidden: None, lens: None };
        check(&mut maker, &PatternRequest { lens: Some(lens.clone()), ..wanted.clone() });
        for count in [1, 5000, visible - 1, visible, view.pixels()] {
            check(&mut maker, &PatternRequest { hidden: Some(hidden.clone()), count, ..wanted.clone() });
        }
        check(&mut maker, &PatternRequest { hidden: Some(all.clone()), ..wanted });
    }
}

/// On a processor, too, groups may count together, as on graphics cards.
#[test]
fn groups_that_count_together_choose_the_same() {
    let Some(device) = testing::processor() else { return };
    let mut maker = PatternMaker::with_group(&device, 256).unwrap();
    let (view, law) = (view(640, 401), Law::default());
    let hidden = Arc::new(BitMask::from_fn(640, 401, |x, y| x < 9 || y % 4 == 0));
    for (x, hidden) in [(0.3, None), (0.7, Some(hidden))] {
        let gaze = DVec2::new(x, 0.4);
        check(&mut maker, &PatternRequest { view, law, gaze, count: 20_000, hidden, lens: None });
    }
}

/// Of a long even view some pixels have the same key, since repetitions of the mask add the same to it: for some of these
/// numbers of samples only a part of them is taken.
#[test]
fn of_equal_keys_the_first_pixels_are_taken() {
    let Some(mut maker) = maker() else { return };
    let (view, law, gaze) = (view(65536, 3), Law::Uniform, DVec2::splat(0.5));
    for count in (50_000..51_000).step_by(23) {
        check(&mut maker, &PatternRequest { view, law, gaze, count, hidden: None, lens: None });
    }
}
