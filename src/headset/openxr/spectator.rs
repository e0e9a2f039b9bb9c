//! The first view's picture, kept for spectators as it is handed over.

use super::fault::{Notes, Outcome};
use super::swapchain::Formats;
use crate::error::Result;
use crate::gpu::vulkan::{Commands, Context, Format, Image, Target};

/// What is kept: bytes as screens take them.
const KEPT: Format = Format::R8G8B8A8_SRGB;

/// A copy of one picture, made only where somebody waits for it.
pub struct Spectator {
    context: Context,
    commands: Commands,
    image: Option<Image>,
    /// The next picture is to be kept.
    pub wanted: bool,
    /// It was, and nobody has seen it.
    fresh: bool,
}

impl Spectator {
    /// For images of some formats; nothing where they cannot be copied, which is noted.
    ///
    /// # Errors
    /// Without memory.
    pub fn new(context: &Context, formats: Formats, notes: &mut Notes) -> Outcome<Option<Spectator>> {
        if !formats.copied || !context.blits(formats.color, KEPT) {
            notes.note(format!("images of {:?} cannot be copied: the mirror stays empty", formats.color));
            return Ok(None);
        }
        let (context, commands) = (context.clone(), Commands::new(context)?);
        Ok(Some(Spectator { context, commands, image: None, wanted: false, fresh: false }))
    }

    /// Keeps a picture; done in the order of what is submitted to the device, so nobody waits.
    ///
    /// # Errors
    /// Without memory, or where the device is lost.
    pub fn keep(&mut self, picture: &Target) -> Result<()> {
        // Commands are recorded anew only once the device is done with them.
        if !self.commands.is_done()? {
            return Ok(());
        }
        let size = (picture.width(), picture.height());
        let fits = |image: &&Image| (image.target().width(), image.target().height()) == size;
        let image = match self.image.take().filter(|image| fits(&image)) {
            Some(image) => image,
            None => Image::new(&self.context, KEPT, size.0, size.1)?,
        };
        let image = self.image.insert(image);
        self.commands.begin()?;
        self.commands.blit(picture, image.target());
        self.commands.submit()?;
        (self.wanted, self.fresh) = (false, true);
        Ok(())
    }

    /// What was kept last, once.
    pub fn take(&mut self) -> Option<&Target> {
        std::mem::take(&mut self.fresh).then(|| self.image.as_ref().map(Image::target)).flatten()
    }
}
