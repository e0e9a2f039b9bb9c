use std::fs::File;
use std::io::BufReader;

use image::AnimationDecoder;
use image::codecs::gif::GifDecoder;

use super::*;

const SIZE: (u32, u32) = (640, 400);

/// Two eyes' pictures of a ball that moves over a checkered plane, in colours of many hues.
fn picture(frame: usize, (width, height): (u32, u32)) -> Vec<u8> {
    let eye = f64::from(width) / 2.0;
    let mut rgba = Vec::with_capacity((width * height * 4) as usize);
    for y in 0..height {
        for x in 0..width {
            let (u, v) = ((f64::from(x) % eye) / eye, f64::from(y) / f64::from(height));
            let disparity = if f64::from(x) < eye { 0.02 } else { -0.02 };
            let ball = (u - 0.3 - 0.01 * frame as f64 - disparity).hypot((v - 0.5) * 1.25);
            let check = ((u * 12.0 + 0.2 * frame as f64) as i32 + (v * 12.0) as i32) % 2;
            let shade = if ball < 0.15 { 1.0 - ball * 4.0 } else { 0.35 + 0.25 * f64::from(check) };
            let colour = if ball < 0.15 { [1.0, 0.5, 0.2] } else { [u, 1.0 - v, v] };
            rgba.extend(colour.map(|c: f64| (255.0 * (c * shade).sqrt()) as u8));
            rgba.push(255);
        }
    }
    rgba
}

fn gif_frames(path: &Path) -> Vec<image::Frame> {
    let decoder = GifDecoder::new(BufReader::new(File::open(path).unwrap())).unwrap();
    decoder.into_frames().collect_frames().unwrap()
}

fn message(result: Result<impl std::fmt::Debug>) -> String {
    result.expect_err("it must fail").to_string()
}

#[test]
fn pictures_sheet_and_animation_decode_again() {
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("a/b");
    let mut sink = PictureSink::create(&out).unwrap();
    for frame in 0..40 {
        sink.push(frame, SIZE.0, SIZE.1, picture(frame, SIZE)).unwrap();
    }
    let files = sink.finish().unwrap();
    assert_eq!((files.pictures, &files.directory), (40, &out));
    let third = image::open(out.join("frame_0003.png")).unwrap();
    assert_eq!(third.to_rgba8().into_raw(), picture(3, SIZE), "PNG keeps every value");
    let sheet = image::open(files.contact_sheet.unwrap()).unwrap();
    assert_eq!((sheet.width(), sheet.height()), (4 * 486 + 6, 5 * 306 + 6));
    let frames = gif_frames(&files.preview.unwrap());
    assert_eq!(frames.len(), 40);
    for (i, frame) in frames.iter().enumerate() {
        assert_eq!(frame.buffer().dimensions(), (480, 300));
        assert_eq!(frame.delay().numer_denom_ms(), (80, 1));
        // The animation shows this frame, not its neighbours: near its own thumbnail in the mean.
        let image = RgbaImage::from_raw(SIZE.0, SIZE.1, picture(i, SIZE)).unwrap();
        let own = image::imageops::thumbnail(&image, 480, 300);
        let pairs = own.as_raw().iter().zip(frame.buffer().as_raw());
        let error = pairs.map(|(&a, &b)| f64::from(a.abs_diff(b))).sum::<f64>() / own.as_raw().len() as f64;
        assert!(error < 4.0, "frame {i}: mean error {error}");
    }
}

#[test]
fn few_small_and_changing_pictures_are_fine() {
    let directory = tempfile::tempdir().unwrap();
    let files = PictureSink::create(directory.path()).unwrap().finish().unwrap();
    assert_eq!((files.pictures, files.contact_sheet, files.preview), (0, None, None));
    let mut sink = PictureSink::create(directory.path()).unwrap();
    sink.push(12_345, 1, 1, [1, 2, 3, 0]).unwrap();
    sink.push(7, 9, 2, vec![200; 72]).unwrap();
    let files = sink.finish().unwrap();
    assert!(directory.path().join("frame_12345.png").exists());
    assert_eq!(image::image_dimensions(directory.path().join("frame_0007.png")).unwrap(), (9, 2));
    assert_eq!(gif_frames(&files.preview.unwrap()).len(), 2);
}

#[test]
fn long_runs_hold_few_thumbnails() {
    let directory = tempfile::tempdir().unwrap();
    let mut sink = PictureSink::create(directory.path()).unwrap();
    for frame in 0..300 {
        sink.push(frame, 4, 2, [frame as u8; 32]).unwrap();
    }
    let files = sink.finish().unwrap();
    assert_eq!(files.pictures, 300);
    assert_eq!(gif_frames(&files.preview.unwrap()).len(), 75);
}

#[test]
fn dropping_the_sink_keeps_what_was_pushed() {
    let directory = tempfile::tempdir().unwrap();
    let mut sink = PictureSink::create(directory.path()).unwrap();
    (0..3).for_each(|frame| sink.push(frame, 64, 64, vec![90; 64 * 64 * 4]).unwrap());
    drop(sink);
    for frame in 0..3 {
        assert!(image::open(directory.path().join(format!("frame_{frame:04}.png"))).is_ok());
    }
}

#[test]
fn a_file_in_the_directorys_place_is_told() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("out");
    fs::write(&file, "kept").unwrap();
    for path in [file.clone(), file.join("deeper")] {
        let message = message(PictureSink::create(&path));
        assert!(message.contains("is a file") && message.contains("choose another"), "{message}");
    }
    assert_eq!(fs::read(&file).unwrap(), b"kept");
}

#[cfg(unix)]
#[test]
fn a_read_only_directory_is_told() {
    use std::os::unix::fs::PermissionsExt;
    let directory = tempfile::tempdir().unwrap();
    fs::set_permissions(directory.path(), fs::Permissions::from_mode(0o555)).unwrap();
    let writable_all_the_same = File::create(directory.path().join("probe")).is_ok();
    if writable_all_the_same {
        println!("not run: this user may write to read-only directories");
    } else {
        let message = message(PictureSink::create(directory.path()));
        assert!(message.contains("may not write"), "{message}");
    }
    fs::set_permissions(directory.path(), fs::Permissions::from_mode(0o755)).unwrap();
}

#[cfg(target_os = "linux")]
#[test]
fn a_directory_that_nobody_can_write_is_told() {
    let message = message(PictureSink::create("/proc/self"));
    assert!(message.starts_with("/proc/self: "), "{message}");
}

/// Pushes small pictures until the sink refuses one; the refusal may come late, never not at all.
fn push_until_refused(sink: &mut PictureSink) -> String {
    let refused = (0..1000).find_map(|frame| sink.push(frame, 8, 8, vec![50; 256]).err());
    refused.expect("the error is told").to_string()
}

#[test]
fn what_stops_the_writer_is_told_once_and_keeps_what_was_written() {
    let directory = tempfile::tempdir().unwrap();
    fs::create_dir(directory.path().join("frame_0003.png")).unwrap();
    let mut sink = PictureSink::create(directory.path()).unwrap();
    let message = push_until_refused(&mut sink);
    assert!(message.contains("frame_0003.png") && message.contains("a folder is in its place"), "{message}");
    let again = sink.push(0, 1, 1, [0; 4]).unwrap_err().to_string();
    assert!(again.contains("no more pictures"), "{again}");
    let files = sink.finish().unwrap();
    assert_eq!(files.pictures, 3);
    assert_eq!(gif_frames(&files.preview.unwrap()).len(), 3);
    assert!(image::open(directory.path().join("frame_0002.png")).is_ok());
}

#[test]
fn an_error_that_no_push_met_is_told_in_the_end() {
    let directory = tempfile::tempdir().unwrap();
    fs::create_dir(directory.path().join("frame_0001.png")).unwrap();
    let mut sink = PictureSink::create(directory.path()).unwrap();
    sink.push(0, 8, 8, vec![50; 256]).unwrap();
    sink.push(1, 8, 8, vec![50; 256]).unwrap();
    let message = message(sink.finish());
    assert!(message.contains("frame_0001.png") && message.contains("a folder is in its place"), "{message}");
    assert!(directory.path().join("contact_sheet.png").exists());
}

#[test]
#[should_panic(expected = "width * height * 4 bytes")]
fn a_picture_of_the_wrong_length_is_a_mistake() {
    let directory = tempfile::tempdir().unwrap();
    let _ = PictureSink::create(directory.path()).unwrap().push(0, 8, 8, vec![0; 255]);
}
