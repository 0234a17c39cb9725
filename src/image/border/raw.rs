//! What only tests ask of an image: names, attributes, levels, and numbers as the file has them.

use openimageio_sys as sys;

use super::{Input, Refusal, c_string, call, text_of};
use crate::image::picture::ChannelFormat;

impl Input {
    /// Whole numbers, bit by bit, of a part whose channels are all [`ChannelFormat::Uint`].
    pub(in crate::image) fn read_uint(
        &mut self,
        part: u32,
        channels: u32,
    ) -> Result<Vec<u32>, Refusal> {
        let info = self.info(part)?;
        let count = (info.width * info.height * channels) as usize;
        let pixels = vec![0_u32; count];
        self.fill(
            [part, 0],
            channels,
            sys::OIIO_BORDER_UINT32,
            usize::MAX,
            pixels,
        )
    }

    /// Name and format of a channel; `None`: a byte.
    pub(in crate::image) fn channel(
        &mut self,
        part: u32,
        channel: u32,
    ) -> Result<(String, Option<ChannelFormat>), Refusal> {
        let (mut format, mut name) = (0, [0; 256]);
        call(|message, message_size| {
            // SAFETY: the handle is alive and ours alone; the buffers are ours and their sizes are passed.
            unsafe {
                sys::oiio_border_channel(
                    self.handle.as_ptr(),
                    part,
                    channel,
                    &mut format,
                    name.as_mut_ptr(),
                    name.len(),
                    message,
                    message_size,
                )
            }
        })?;
        let format = match format {
            sys::OIIO_BORDER_HALF => Some(ChannelFormat::Half),
            sys::OIIO_BORDER_FLOAT => Some(ChannelFormat::Float),
            sys::OIIO_BORDER_UINT32 => Some(ChannelFormat::Uint),
            _ => None,
        };
        Ok((text_of(&name), format))
    }

    /// An attribute, as text.
    pub(in crate::image) fn attribute(&mut self, part: u32, name: &str) -> Result<String, Refusal> {
        let (name, mut text) = (c_string(name.as_bytes())?, [0; 1024]);
        call(|message, message_size| {
            // SAFETY: the handle is alive and ours alone; the buffers are ours and their sizes are passed.
            unsafe {
                sys::oiio_border_attribute(
                    self.handle.as_ptr(),
                    part,
                    name.as_ptr(),
                    text.as_mut_ptr(),
                    text.len(),
                    message,
                    message_size,
                )
            }
        })?;
        Ok(text_of(&text))
    }

    /// All channels of a MIP level of a part, bit by bit.
    pub(in crate::image) fn level_bytes(
        &mut self,
        part: u32,
        level: u32,
        format: Raw,
    ) -> Result<Vec<u8>, Refusal> {
        let info = self.level_info(part, level)?;
        let count = (info.width * info.height * info.channels) as usize;
        let (format, sample) = match format {
            Raw::U8 => (sys::OIIO_BORDER_UINT8, 1),
            Raw::U16 => (sys::OIIO_BORDER_UINT16, 2),
            Raw::F16 => (sys::OIIO_BORDER_HALF, 2),
            Raw::F32 => (sys::OIIO_BORDER_FLOAT, 4),
        };
        let bytes = vec![0_u8; count * sample];
        self.fill([part, level], info.channels, format, usize::MAX, bytes)
    }
}

/// Formats that are read as they are.
#[derive(Debug, Clone, Copy)]
pub(in crate::image) enum Raw {
    U8,
    U16,
    F16,
    F32,
}
