//! Where the mock headset's pictures go: files.

use std::fmt::Display;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, RgbaImage};

use super::animation;
use super::preview::Thumbnails;
use crate::error::{Error, Result};
use crate::whole_file;

/// Pictures that wait for the writer at most; one more and [`PictureSink::push`] waits too.
const QUEUE: usize = 2;

/// Writes each picture as `frame_0000.png`, ... on a thread of its own, and a contact sheet and an
/// animation in the end. Holds a few pictures and a bounded number of thumbnails, however long the run.
///
/// Dropping it waits for the pictures that were pushed.
#[derive(Debug)]
pub struct PictureSink {
    directory: PathBuf,
    writer: Option<Writer>,
    outcome: Outcome,
}

/// What [`PictureSink::finish`] leaves in the directory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Files {
    /// The directory.
    pub directory: PathBuf,
    /// How many `frame_*.png` were written.
    pub pictures: usize,
    /// At most 20 evenly chosen pictures in one; `None` when there were no pictures.
    pub contact_sheet: Option<PathBuf>,
    /// The run as an animated GIF; `None` when there were no pictures.
    pub preview: Option<PathBuf>,
}

/// The thread that writes, and the way to it.
#[derive(Debug)]
struct Writer {
    queue: SyncSender<Picture>,
    thread: JoinHandle<Outcome>,
}

/// A picture on its way to the writer.
struct Picture {
    index: usize,
    image: RgbaImage,
}

/// What the writer did.
#[derive(Debug, Default)]
struct Outcome {
    pictures: usize,
    thumbnails: Thumbnails,
    /// What stopped it, until it is told.
    error: Option<Error>,
}

impl PictureSink {
    /// Makes the directory, where it is not there yet, and starts the writer. Pictures of an earlier run, which its
    /// `frames.jsonl` proves, are removed; other files stay, except those of the same names.
    ///
    /// # Errors
    /// Where the directory cannot be made or written to.
    pub fn create(directory: impl Into<PathBuf>) -> Result<Self> {
        let directory = directory.into();
        fs::create_dir_all(&directory).map_err(|e| Error::writing(&directory, &e))?;
        // Told before the first frame is traced rather than after it.
        whole_file::check_folder(&directory)?;
        if directory.join("frames.jsonl").is_file() {
            remove_pictures(&directory)?;
        }
        let (queue, pictures) = sync_channel(QUEUE);
        let to = directory.clone();
        let thread = std::thread::Builder::new()
            .name("pictures".into())
            .spawn(move || write_all(&to, &pictures))
            .map_err(|e| Error::writing(&directory, &e))?;
        Ok(PictureSink { directory, writer: Some(Writer { queue, thread }), outcome: Outcome::default() })
    }

    /// Hands over a picture: rows from the top, four bytes a pixel, sRGB, both eyes side by side. Alpha is
    /// not written. Waits only while the writer is more than two pictures behind.
    ///
    /// # Errors
    /// Once an earlier picture could not be written: what stopped it, and from then on that it stopped.
    ///
    /// # Panics
    /// Where `rgba` is not `width * height * 4` bytes, or there are none.
    pub fn push(&mut self, index: usize, width: u32, height: u32, rgba: impl Into<Vec<u8>>) -> Result<()> {
        let rgba = rgba.into();
        let bytes = u128::from(width) * u128::from(height) * 4;
        assert!(bytes > 0 && rgba.len() as u128 == bytes, "a picture is width * height * 4 bytes");
        let image = RgbaImage::from_raw(width, height, rgba).expect("its length was checked");
        let Some(writer) = &self.writer else { return Err(self.stopped()) };
        if writer.queue.send(Picture { index, image }).is_ok() {
            return Ok(());
        }
        self.stop();
        Err(self.outcome.error.take().unwrap_or_else(|| self.stopped()))
    }

    /// Waits for the writer, then writes `contact_sheet.png` and `preview.gif` of the pictures that were
    /// written, even if an error ended the run.
    ///
    /// # Errors
    /// Where a picture, the sheet or the animation could not be written and no [`push`](Self::push) has
    /// said so yet. What was written before stays.
    pub fn finish(mut self) -> Result<Files> {
        self.stop();
        let Outcome { pictures, thumbnails, error } = std::mem::take(&mut self.outcome);
        let previews = write_previews(&self.directory, &thumbnails);
        if let Some(error) = error {
            return Err(error);
        }
        let (contact_sheet, preview) = previews?.unzip();
        Ok(Files { directory: std::mem::take(&mut self.directory), pictures, contact_sheet, preview })
    }

    /// Lets the writer write what is queued and end.
    fn stop(&mut self) {
        let Some(Writer { queue, thread }) = self.writer.take() else { return };
        drop(queue);
        self.outcome =
            thread.join().unwrap_or_else(|_| Outcome { error: Some(self.stopped()), ..Outcome::default() });
    }

    fn stopped(&self) -> Error {
        let problem = "no more pictures are written here since one failed; start the run again".to_string();
        Error::File { path: self.directory.clone(), problem }
    }
}

/// Removes what [`PictureSink::push`] has written there before.
fn remove_pictures(directory: &Path) -> Result<()> {
    let fail = |error: &std::io::Error| Error::writing(directory, error);
    let number = |name: &str| Some(name.strip_prefix("frame_")?.strip_suffix(".png")?.to_string());
    for entry in fs::read_dir(directory).map_err(|e| fail(&e))? {
        let entry = entry.map_err(|e| fail(&e))?;
        let number = entry.file_name().to_str().and_then(number);
        if number.is_some_and(|number| number.len() >= 4 && number.bytes().all(|b| b.is_ascii_digit())) {
            fs::remove_file(entry.path()).map_err(|e| Error::writing(&entry.path(), &e))?;
        }
    }
    Ok(())
}

impl Drop for PictureSink {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Writes pictures until there are no more or one fails, which closes the queue.
fn write_all(directory: &Path, pictures: &Receiver<Picture>) -> Outcome {
    let mut outcome = Outcome::default();
    for Picture { index, image } in pictures {
        let image = DynamicImage::ImageRgba8(image);
        if let Err(error) = write_png(&directory.join(format!("frame_{index:04}.png")), &image) {
            outcome.error = Some(error);
            break;
        }
        outcome.pictures += 1;
        if let DynamicImage::ImageRgba8(image) = &image {
            outcome.thumbnails.push(image);
        }
    }
    outcome
}

/// The contact sheet and the animation, where there are thumbnails.
fn write_previews(directory: &Path, thumbnails: &Thumbnails) -> Result<Option<(PathBuf, PathBuf)>> {
    if thumbnails.all().is_empty() {
        return Ok(None);
    }
    let sheet = directory.join("contact_sheet.png");
    write_png(&sheet, &DynamicImage::ImageRgba8(thumbnails.contact_sheet()))?;
    let preview = directory.join("preview.gif");
    write_encoded(&preview, |bytes| animation::write(thumbnails.all(), bytes))?;
    Ok(Some((sheet, preview)))
}

/// Compresses little: a picture must not take longer to write than to trace.
fn write_png(path: &Path, picture: &DynamicImage) -> Result<()> {
    write_encoded(path, |bytes| {
        let encoder = PngEncoder::new_with_quality(bytes, CompressionType::Fast, FilterType::Adaptive);
        picture.to_rgb8().write_with_encoder(encoder)
    })
}

/// Encodes in memory, then writes the whole file or nothing.
fn write_encoded<E: Display>(path: &Path, encode: impl FnOnce(&mut Vec<u8>) -> Result<(), E>) -> Result<()> {
    let mut bytes = Vec::new();
    encode(&mut bytes).map_err(|error| Error::File {
        path: path.to_path_buf(),
        problem: format!("its format does not hold this picture ({error}); choose a smaller one"),
    })?;
    whole_file::write(path, |file| file.write_all(&bytes).map_err(|e| Error::writing(path, &e)))
}

#[cfg(test)]
mod tests;
