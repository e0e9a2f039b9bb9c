//! Environment maps from files, checked and made to fit.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use exr::prelude::{MetaData, ReadChannels, ReadLayers, Vec2};
use glam::Vec3;
use image::ImageDecoder;
use image::codecs::hdr::{HdrDecoder, HdrMetadata};

use super::Environment;
use crate::error::{Error, Result};

/// Pixels as they are in a file, rows from the top.
struct Pixels {
    width: usize,
    height: usize,
    texels: Vec<Vec3>,
}

/// See [`Environment::load`].
pub(super) fn load(path: &Path) -> Result<(Environment, Vec<String>)> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    if !std::fs::metadata(path).map_err(|e| Error::io(path, &e))?.is_file() {
        return Err(problem(path, "it is not a regular file; give the path of a map"));
    }
    let mut pixels = match extension.as_str() {
        "hdr" => load_hdr(path)?,
        "exr" => load_exr(path)?,
        _ => {
            return Err(problem(
                path,
                "its name ends neither in .hdr nor in .exr; give a map of one of these",
            ));
        }
    };
    let mut warnings = Vec::new();
    let repaired = repair(&mut pixels.texels);
    if repaired > 0 {
        warnings.push(format!(
            "environment {}: {repaired} texels were not finite or were negative; those channels are 0 now.",
            path.display()
        ));
    }
    if pixels.width != 2 * pixels.height {
        warnings.push(format!(
            "environment {}: it is {}x{} texels, and latitude-longitude maps are twice as wide as high; it is stretched to all directions. If it is a cross or a strip of a cube, convert it first.",
            path.display(),
            pixels.width,
            pixels.height
        ));
    }
    let factor = pixels.width.div_ceil(Environment::MAX_WIDTH as usize);
    if factor > 1 {
        pixels = shrink(&pixels, factor);
    }
    let Pixels { width, height, texels } = pixels;
    Ok((Environment { width: width as u32, height: height as u32, texels, sun: None }, warnings))
}

/// See [`Environment::reduced`].
pub(super) fn reduced(map: &Environment, factor: usize) -> Environment {
    let (width, height) = (map.width as usize, map.height as usize);
    let Pixels { width, height, texels } =
        shrink(&Pixels { width, height, texels: map.texels.clone() }, factor);
    Environment { width: width as u32, height: height as u32, texels, sun: map.sun }
}

/// Sets channels that are not finite or are negative to 0; returns how many texels had such.
pub(super) fn repair(texels: &mut [Vec3]) -> usize {
    let sane = |c: f32| if c.is_finite() && c > 0.0 { c } else { 0.0 };
    let mut repaired = 0;
    for texel in texels {
        if !(texel.is_finite() && texel.min_element() >= 0.0) {
            repaired += 1;
            *texel = Vec3::new(sane(texel.x), sane(texel.y), sane(texel.z));
        }
    }
    repaired
}

/// Averages `factor` x `factor` texels into one, for sizes that are multiples of it. Other sizes are
/// divided by it and rounded up, and every new texel averages its share of the old picture, fractions
/// of texels included, so that directions stay where they are.
fn shrink(pixels: &Pixels, factor: usize) -> Pixels {
    let columns = shares(pixels.width, pixels.width.div_ceil(factor));
    let rows = shares(pixels.height, pixels.height.div_ceil(factor));
    let mut texels = Vec::with_capacity(columns.len() * rows.len());
    for row in &rows {
        for column in &columns {
            let sum: glam::DVec3 = row
                .iter()
                .flat_map(|&(y, wy)| column.iter().map(move |&(x, wx)| (y * pixels.width + x, wx * wy)))
                .map(|(index, weight)| pixels.texels[index].as_dvec3() * weight)
                .sum();
            texels.push(sum.as_vec3());
        }
    }
    Pixels { width: columns.len(), height: rows.len(), texels }
}

/// For each of `new` equal parts of a line of `old` texels: the texels it covers and their shares, which
/// add up to 1.
fn shares(old: usize, new: usize) -> Vec<Vec<(usize, f64)>> {
    let size = old as f64 / new as f64;
    (0..new)
        .map(|i| {
            // Whole numbers in the numerators keep the ends exact.
            let (start, end) = ((i * old) as f64 / new as f64, ((i + 1) * old) as f64 / new as f64);
            (start.floor() as usize..(end.ceil() as usize).min(old))
                .map(|t| (t, (end.min((t + 1) as f64) - start.max(t as f64)) / size))
                .filter(|&(_, share)| share > 0.0)
                .collect()
        })
        .collect()
}

fn load_hdr(path: &Path) -> Result<Pixels> {
    let file = File::open(path).map_err(|e| Error::io(path, &e))?;
    let damaged = |e| problem(path, &format!("it is not a readable Radiance picture ({e}); get it again"));
    let decoder = HdrDecoder::new(BufReader::new(file)).map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    check_size(path, width, height)?;
    let scale = radiance_scale(&decoder.metadata());
    let mut floats = vec![0.0f32; width * height * 3];
    decoder.read_image(bytemuck::cast_slice_mut(&mut floats)).map_err(damaged)?;
    let texels = floats.chunks_exact(3).map(|texel| Vec3::from_slice(texel) * scale).collect();
    Ok(Pixels { width, height, texels })
}

/// What a Radiance picture's values are multiplied by to be radiance again: its header's EXPOSURE and COLORCORR
/// lines tell what they have been multiplied by (Ward, "Real Pixels", Graphics Gems II). Lines that make no
/// sense are as good as none.
fn radiance_scale(header: &HdrMetadata) -> Vec3 {
    let correction = header.color_correction.map_or(Vec3::ONE, Vec3::from);
    let scale = (correction * header.exposure.unwrap_or(1.0)).recip();
    if scale.is_finite() && scale.min_element() > 0.0 { scale } else { Vec3::ONE }
}

fn load_exr(path: &Path) -> Result<Pixels> {
    let damaged = |e: exr::error::Error| match e {
        exr::error::Error::Io(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => Error::io(path, &e),
        e => problem(
            path,
            &format!("it is not a readable OpenEXR picture with R, G and B ({e}); get it again"),
        ),
    };
    let meta = MetaData::read_from_file(path, false).map_err(damaged)?;
    for header in &meta.headers {
        check_size(path, header.layer_size.width(), header.layer_size.height())?;
        if header.shared_attributes.display_window.size != header.layer_size {
            return Err(problem(path, "its data window is not its display window; save it uncropped"));
        }
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size: Vec2<usize>, _| Pixels {
                width: size.width(),
                height: size.height(),
                texels: vec![Vec3::ZERO; size.area()],
            },
            |pixels, at, (r, g, b): (f32, f32, f32)| {
                pixels.texels[at.y() * pixels.width + at.x()] = Vec3::new(r, g, b);
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(damaged)?;
    Ok(image.layer_data.channel_data.pixels)
}

fn check_size(path: &Path, width: usize, height: usize) -> Result<()> {
    let [max_width, max_height] = Environment::MAX_FILE_SIZE.map(|m| m as usize);
    if width == 0 || height == 0 || width > max_width || height > max_height {
        let text = format!(
            "it is {width}x{height} texels, and 1x1 to {max_width}x{max_height} are accepted; make it smaller"
        );
        return Err(problem(path, &text));
    }
    Ok(())
}

fn problem(path: &Path, problem: &str) -> Error {
    Error::Environment { path: path.to_path_buf(), problem: problem.replace('\n', " ") }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    /// The folder of test data, when it is there.
    fn data() -> Option<PathBuf> {
        let folder = std::env::var_os("FOVEATE_TEST_DATA")
            .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
        folder.is_dir().then_some(folder)
    }

    fn write_hdr(path: &Path, width: usize, height: usize, texel: impl Fn(usize) -> [f32; 3]) {
        let pixels: Vec<_> = (0..width * height).map(|i| image::Rgb(texel(i))).collect();
        let encoder = image::codecs::hdr::HdrEncoder::new(File::create(path).unwrap());
        encoder.encode(&pixels, width, height).unwrap();
    }

    fn refusal(path: &Path) -> String {
        let text = load(path).unwrap_err().to_string();
        assert!(text.contains(&path.display().to_string()) && !text.contains('\n'), "{text}");
        text
    }

    #[test]
    fn real_maps_load() {
        let Some(folder) = data().map(|d| d.join("hdri")) else {
            println!("not run: the test data is missing");
            return;
        };
        let mut maps = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|e| e != "hdr" && e != "exr") {
                continue;
            }
            let (map, _) = load(&path).unwrap();
            assert_eq!((map.width, map.height, map.texels.len()), (1024, 512, 1024 * 512));
            assert!(map.texels.iter().all(|t| t.is_finite() && t.min_element() >= 0.0));
            assert!(map.texels.iter().any(|t| t.max_element() > 0.5));
            maps += 1;
        }
        assert!(maps > 0);
    }

    #[test]
    fn both_formats_hold_the_same_picture() {
        let folder = tempfile::tempdir().unwrap();
        let (hdr, exr) = (folder.path().join("a.hdr"), folder.path().join("a.EXR"));
        let texel = |i: usize| [i as f32, 2.0, 0.25 * i as f32];
        write_hdr(&hdr, 16, 8, texel);
        exr::prelude::write_rgb_file(&exr, 16, 8, |x, y| texel(y * 16 + x).into()).unwrap();
        let (a, b) = (load(&hdr).unwrap().0, load(&exr).unwrap().0);
        for (i, (a, b)) in a.texels.iter().zip(&b.texels).enumerate() {
            assert_eq!(*b, Vec3::from(texel(i)));
            assert!((*a - *b).abs().max_element() <= b.max_element() / 128.0, "{a} {b}");
        }
    }

    #[test]
    fn bad_texels_become_black_and_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bad.exr");
        let texel = |x: usize| [f32::NAN, f32::INFINITY, -1.0, 3.0][x];
        let red = |x, y| if y == 0 { texel(x) } else { 1.0 };
        exr::prelude::write_rgb_file(&path, 4, 2, |x, y| (red(x, y), 1.0, 2.0)).unwrap();
        let (map, warnings) = load(&path).unwrap();
        assert_eq!(map.texels[..3], [Vec3::new(0.0, 1.0, 2.0); 3]);
        assert_eq!(map.texels[3], Vec3::new(3.0, 1.0, 2.0));
        assert!(warnings.len() == 1 && warnings[0].contains(" 3 texels"), "{warnings:?}");
    }

    #[test]
    fn wide_maps_shrink_and_keep_their_light() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("wide.exr");
        exr::prelude::write_rgb_file(&path, 8192, 4, |x, y| ((x % 2) as f32, y as f32, 1.0)).unwrap();
        let (map, _) = load(&path).unwrap();
        assert_eq!((map.width, map.height), (4096, 2));
        assert!(map.texels[..4096].iter().all(|&t| t == Vec3::new(0.5, 0.5, 1.0)));
        assert!(map.texels[4096..].iter().all(|&t| t == Vec3::new(0.5, 2.5, 1.0)));
        let smaller = map.reduced(2);
        assert_eq!((smaller.width, smaller.height), (2048, 1));
        assert!(smaller.texels.iter().all(|&t| t == Vec3::new(0.5, 1.5, 1.0)));
    }

    #[test]
    fn a_radiance_pictures_exposure_is_taken_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.hdr");
        write_hdr(&path, 16, 8, |_| [1.0, 2.0, 4.0]);
        let plain = std::fs::read(&path).unwrap();
        let with = |lines: &str| {
            // After the first line, which names the format.
            let end = plain.iter().position(|&b| b == b'\n').unwrap() + 1;
            std::fs::write(&path, [&plain[..end], lines.as_bytes(), &plain[end..]].concat()).unwrap();
            load(&path).unwrap().0.texels[0]
        };
        assert_eq!(with(""), Vec3::new(1.0, 2.0, 4.0));
        // Each line tells of a further change.
        assert_eq!(with("EXPOSURE=2\nEXPOSURE= 4.0\n"), Vec3::new(1.0, 2.0, 4.0) / 8.0);
        assert_eq!(with("EXPOSURE=0.5\nCOLORCORR=1 2 4\n"), Vec3::splat(2.0));
        for nonsense in ["EXPOSURE=0\n", "EXPOSURE=nan\n", "EXPOSURE=-3\n", "EXPOSURE=inf\n"] {
            assert_eq!(with(nonsense), Vec3::new(1.0, 2.0, 4.0), "{nonsense}");
        }
    }

    #[test]
    fn maps_that_are_not_twice_as_wide_as_high_are_told_of() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.hdr");
        for (width, height, told) in [(16, 8, 0), (16, 16, 1), (12, 16, 1)] {
            write_hdr(&path, width, height, |_| [1.0; 3]);
            let (map, warnings) = load(&path).unwrap();
            assert_eq!((map.width as usize, map.height as usize, warnings.len()), (width, height, told));
            assert!(warnings.iter().all(|w| w.contains("16 texels") && w.contains("twice as wide")));
        }
    }

    #[test]
    fn fractions_of_texels_are_shared_out() {
        for (old, new) in [(7, 3), (4097, 1366), (5, 5), (3, 1)] {
            let parts = shares(old, new);
            assert_eq!(parts.len(), new);
            let mut given = vec![0.0; old];
            for &(texel, share) in parts.iter().flatten() {
                given[texel] += share;
            }
            assert!(given.iter().all(|g| (g - new as f64 / old as f64).abs() < 1e-9));
        }
    }

    #[test]
    fn what_cannot_be_used_is_refused_in_one_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        assert!(load(&folder.path().join("none.hdr")).unwrap_err().to_string().contains("no such file"));
        assert!(load(&folder.path().join("none.exr")).unwrap_err().to_string().contains("no such file"));
        assert!(refusal(&file("a.png", b"")).contains(".hdr"));
        assert!(refusal(&file("a.hdr", b"")).contains("Radiance"));
        assert!(refusal(&file("a.exr", b"what?")).contains("OpenEXR"));
        let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 100000\n";
        assert!(refusal(&file("huge.hdr", huge)).contains("100000x100000"));
        let empty = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 0 +X 8\n";
        refusal(&file("empty.hdr", empty));
    }

    /// Cuts a file at many places and overwrites bytes of it: each time there is a map or a sentence.
    fn survives_damage(original: &Path) {
        let bytes = std::fs::read(original).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("damaged").with_extension(original.extension().unwrap());
        let mut outcomes = [0, 0];
        for step in 0..400usize {
            let mut damaged = bytes.clone();
            let at = step * step * 7919 % bytes.len();
            if step % 4 == 0 {
                damaged.truncate(at);
            } else {
                // Headers are where the dangerous numbers are.
                let at = if step % 4 == 1 { at % bytes.len().min(400) } else { at };
                damaged[at] = [0xff, 0x00, 0x80, 0x7f][step / 4 % 4];
            }
            std::fs::write(&path, damaged).unwrap();
            outcomes[usize::from(load(&path).is_err())] += 1;
        }
        assert!(outcomes[1] > 50, "{outcomes:?}");
    }

    #[test]
    fn damaged_hdr_files_never_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.hdr");
        write_hdr(&path, 64, 32, |i| [(i % 5) as f32, i as f32, 1.0]);
        survives_damage(&path);
    }

    #[test]
    fn damaged_exr_files_never_panic() {
        use exr::prelude::*;
        let folder = tempfile::tempdir().unwrap();
        for (name, compression) in
            [("zip", Compression::ZIP16), ("piz", Compression::PIZ), ("dwab", Compression::DWAB(None))]
        {
            let path = folder.path().join(name).with_extension("exr");
            let channels = SpecificChannels::rgb(|at: Vec2<usize>| (at.x() as f32, at.y() as f32, 1.0f32));
            let encoding = Encoding { compression, ..Encoding::default() };
            let layer = Layer::new((64, 32), LayerAttributes::named("map"), encoding, channels);
            Image::from_layer(layer).write().to_file(&path).unwrap();
            survives_damage(&path);
        }
    }
}
