//! The pass that draws a picture of words.

use bytemuck::{Pod, Zeroable};

use super::{BYTES, Message, SIZE};
use crate::error::Result;
use crate::gpu::vulkan::{
    BufferRef, Commands, Context, Encoding, Format, HostBuffer, PassPipeline, Rect, Shader, Target,
};
use crate::metrics::display::srgb_from_linear;

const SHADER: Shader = Shader {
    name: "message.wgsl",
    words: include_bytes!(concat!(env!("OUT_DIR"), "/message.spv")),
    buffers: 1,
    push: size_of::<Parameters>() as u32,
};

/// Linear light of letters and of what is behind them: bright enough to be read, too dark to blind.
const INK: f32 = 0.8;
const PAPER: f32 = 0.01;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Parameters {
    ink: [f32; 4],
    paper: [f32; 4],
    corner: [u32; 2],
    stride: u32,
    padding: u32,
}

/// Draws messages.
pub struct MessagePass {
    pipeline: PassPipeline,
    bits: HostBuffer,
}

impl MessagePass {
    /// A pass for targets of a format.
    ///
    /// # Errors
    /// [`crate::Error::Kernel`] if the driver cannot compile the shader, [`crate::Error::Device`] without memory.
    pub fn new(context: &Context, format: Format) -> Result<Self> {
        let pipeline = PassPipeline::new(context, &SHADER, "cover", "write", format)?;
        Ok(MessagePass { pipeline, bits: HostBuffer::new(context, BYTES)? })
    }

    /// Records drawing a message with its upper left corner at a pixel of a target. What was recorded before is done
    /// by then.
    ///
    /// # Errors
    /// [`crate::Error::Device`] without memory.
    pub fn record(
        &mut self,
        commands: &mut Commands,
        message: &Message,
        (target, encoding): (&Target, Encoding),
        [x, y]: [u32; 2],
    ) -> Result<()> {
        let (width, height) = message.size();
        if width == 0 || height == 0 {
            return Ok(());
        }
        self.bits.write(0, &message.bits);
        let grey = |linear: f32| {
            let value = if encoding == Encoding::DisplaySrgb { srgb_from_linear(linear) } else { linear };
            [value, value, value, 1.0]
        };
        let parameters =
            Parameters { ink: grey(INK), paper: grey(PAPER), corner: [x, y], stride: SIZE.0, padding: 0 };
        let buffer = BufferRef::from(&self.bits);
        let rect = Rect { x, y, width, height };
        commands.draw(&self.pipeline, target, rect, &[Some(&buffer)], bytemuck::bytes_of(&parameters))
    }
}

/// Where a message of `size` stands in the middle of each of some eyes' pictures of `width` and `height`, side by side:
/// its upper left corners.
#[cfg(feature = "window")]
pub fn middles(eyes: u32, (width, height): (u32, u32), size: (u32, u32)) -> Vec<[u32; 2]> {
    (0..eyes).map(|eye| [eye * width + (width - size.0) / 2, (height - size.1) / 2]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::vulkan::{Image, testing};

    /// The twin of the shader is [`Message::ink`].
    #[test]
    fn pixels_are_ink_and_paper_as_the_message_says() {
        let Some(context) = testing::context() else { return };
        for format in [Format::R8G8B8A8_UNORM, Format::B8G8R8A8_SRGB] {
            let message = Message::new("waiting for the OpenCL device", (200, 90));
            let image = Image::new(&context, format, 260, 130).unwrap();
            let mut pass = MessagePass::new(&context, format).unwrap();
            let mut commands = Commands::new(&context).unwrap();
            commands.begin().unwrap();
            let target = (image.target(), Encoding::of(format));
            pass.record(&mut commands, &message, target, [33, 21]).unwrap();
            commands.submit().unwrap();
            commands.wait().unwrap();
            let pixels = image.read().unwrap();
            let code = |linear: f32| (srgb_from_linear(linear) * 255.0).round() as u8;
            for (place, pixel) in (0u32..).zip(pixels.chunks(4)) {
                let (x, y) = (place % 260, place / 260);
                let inside = (33..233).contains(&x) && (21..111).contains(&y);
                let wanted = match inside {
                    true if message.ink(x - 33, y - 21) => [code(INK), 255],
                    true => [code(PAPER), 255],
                    false => [0, 0],
                };
                let near = pixel[..3].iter().all(|value| value.abs_diff(wanted[0]) <= 1);
                assert!(near && pixel[3] == wanted[1], "{format:?} {x} {y}: {pixel:?}, not {wanted:?}");
            }
        }
        testing::assert_valid(&context);
    }

    #[cfg(feature = "window")]
    #[test]
    fn each_eye_has_a_message_in_its_middle() {
        assert_eq!(middles(1, (320, 200), (320, 100)), [[0, 50]]);
        assert_eq!(middles(2, (700, 81), (640, 81)), [[30, 0], [730, 0]]);
    }
}
