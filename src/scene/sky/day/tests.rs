use super::super::risen;
use super::*;

fn cycle() -> DayCycle {
    DayCycle { sky: Sky::default(), seconds: 60.0, scale: 1.0 }
}

#[test]
fn the_sun_rises_over_x_stands_over_minus_z_and_sets_over_minus_x() {
    let cycle = cycle();
    let toward = |time: f64| cycle.at(time).sun_direction();
    assert!(toward(0.0).distance(Sky::default().sun_direction()) < 1e-6);
    // A circle around the pole, at an even pace.
    for step in 0..60 {
        let (now, next) = (toward(f64::from(step)), toward(f64::from(step) + 1.0));
        assert!((now.dot(pole()) - toward(0.0).dot(pole())).abs() < 1e-6, "{now}");
        let along = |d: DVec3| (d - pole() * d.dot(pole())).normalize();
        assert!((along(now).angle_between(along(next)).to_degrees() - 6.0).abs() < 1e-3);
    }
    let (mut rises, mut sets, mut noon) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for step in 0..6000 {
        let (now, next) = (toward(f64::from(step) * 0.01), toward(f64::from(step + 1) * 0.01));
        if now.y <= 0.0 && next.y > 0.0 {
            rises = now;
        }
        if now.y > 0.0 && next.y <= 0.0 {
            sets = now;
        }
        noon = if now.y > noon.y { now } else { noon };
    }
    assert!(rises.x > 0.8 && sets.x < -0.8 && noon.z < 0.0 && noon.x.abs() < 0.01, "{rises} {sets} {noon}");
    assert!((noon.y.asin().to_degrees() - cycle.highest()).abs() < 1e-3);
    assert_eq!(cycle.at(60.0), cycle.at(0.0));
    assert_eq!(cycle.at(-45.0), cycle.at(15.0));
}

/// Light of a map as surfaces would have it: mean radiance.
fn mean(map: &Environment) -> f64 {
    f64::from(map.irradiance())
}

#[test]
fn skies_are_those_that_a_still_sun_of_that_time_makes() {
    let cycle = DayCycle { scale: 2.0, ..cycle() };
    let mut day = Day::new(cycle, true);
    for time in [0.0, 3.0, 14.0, 16.0, 30.0, 45.5] {
        let (map, sun) = (day.map(time), day.sun(time));
        let mut right = cycle.at(time).bake();
        right.texels.iter_mut().for_each(|texel| *texel *= 2.0);
        let (is, should) = (mean(&map.environment), mean(&right));
        assert!((is / should - 1.0).abs() < 0.04, "{time}: {is} is not {should}");
        let toward = cycle.at(time).sun_direction();
        assert!(sun.direction.as_dvec3().distance(toward) < 1e-6, "{time}");
        match right.sun {
            Some(still) => {
                assert!(sun.radiance.distance(2.0 * still.radiance) <= 1e-4 * sun.radiance.length())
            }
            None => assert_eq!(sun.radiance, Vec3::ZERO),
        }
        // Everywhere, and where glossy surfaces mirror it.
        let mirrored = glossy::prefiltered(&right);
        let is = map.mirrored.as_ref().unwrap();
        assert_eq!(is.len(), mirrored.len());
        let off = |a: Vec3, b: Vec3| f64::from((a - b).abs().max_element()) / should;
        let maps = map.environment.texels.iter().zip(&right.texels).map(|(a, b)| off(*a, *b));
        let mirrors = is.iter().zip(&mirrored).map(|(a, b)| off(Vec3::from_slice(a), Vec3::from_slice(b)));
        let (count, worst) = (right.texels.len() as f64, maps.clone().fold(0.0, f64::max));
        let (maps, mirrors) = (maps.sum::<f64>() / count, mirrors.sum::<f64>() / mirrored.len() as f64);
        assert!(maps < 0.01 && mirrors < 0.01 && worst < 0.6, "{time}: {maps} {mirrors} {worst}");
    }
}

#[test]
fn skies_lie_where_they_are_looked_for() {
    assert!((0..59).all(|index| place(elevation(index)) == index as f64));
    assert_eq!([-10.0, -12.0, 6.0, 7.0, 90.0].map(place), [0.0, 0.0, 16.0, 16.5, 58.0]);
}

#[test]
fn a_map_depends_on_its_time_alone() {
    let ways = [&[7.0][..], &[0.0, 3.3, 6.6, 7.0], &[50.0, 7.01, 7.0], &[-53.0, 67.0, 7.0]];
    let maps: Vec<_> = ways
        .iter()
        .map(|times| {
            let mut day = Day::new(cycle(), false);
            times.iter().map(|&time| day.map(time)).last().unwrap()
        })
        .collect();
    assert!(maps.iter().all(|map| map.environment == maps[0].environment && map.mirrored.is_none()));
    // What has hardly turned is not made anew.
    let mut day = Day::new(cycle(), false);
    assert!(Arc::ptr_eq(&day.map(7.0), &day.map(7.01)) && !Arc::ptr_eq(&day.map(7.0), &day.map(7.1)));
}

#[test]
fn a_sun_that_touches_the_horizon_fades() {
    let light = |elevation: f32| {
        let sky = Sky { sun_elevation_deg: elevation, ..Sky::default() };
        sky.sun(&sky.atmosphere()).map_or(0.0, |sun| sun.radiance.x)
    };
    let steps: Vec<f32> = (-30..=40).map(|step| light(step as f32 * 0.01)).collect();
    assert!(
        steps.windows(2).all(|pair| pair[0] <= pair[1] && pair[1] - pair[0] < 0.1 * steps[70]),
        "{steps:?}"
    );
    assert!(steps[0] == 0.0 && steps[70] > 0.0);
    assert!((risen(0.0) - 0.5).abs() < 1e-12 && risen(1.0) == 1.0 && risen(-1.0).abs() < 1e-12);
}

#[test]
fn the_brightest_light_is_that_of_noon() {
    let mut day = Day::new(cycle(), false);
    let (brightest, sky) =
        (day.brightest(), Sky { sun_elevation_deg: cycle().highest() as f32, ..Sky::default() });
    let noon = sky.bake();
    assert!((mean(&brightest) / mean(&noon) - 1.0).abs() < 0.03);
    assert_eq!(brightest.sun.unwrap().radiance, noon.sun.unwrap().radiance);
}
