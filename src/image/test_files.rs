//! Pictures that the tests of this module write and read back.

use std::path::Path;

use super::border::{Format, Input, Pixels};
use super::{Channel, ChannelFormat, Compression, Part, Picture};

/// A part with channels of one format, each named by a letter.
pub(super) fn part(name: &str, channels: &str, format: ChannelFormat, pixels: &[f32]) -> Part {
    Part {
        name: name.into(),
        channels: channels
            .chars()
            .map(|name| Channel {
                name: name.into(),
                format,
            })
            .collect(),
        pixels: pixels.to_vec(),
    }
}

/// A picture of one unnamed part, whose pixels fill rows of this width from the top.
pub(super) fn picture(width: u32, part: Part) -> Picture {
    let height = (part.pixels.len() / part.channels.len()) as u32 / width;
    Picture {
        width,
        height,
        display_window: (width, height, 0, 0),
        parts: vec![part],
        metadata: Vec::new(),
        tile: None,
        compression: Compression::Zip,
    }
}

/// Opens what a test has just written.
pub(super) fn open(path: &Path) -> Input {
    Input::open(path.as_os_str(), None).expect("opened")
}

/// The first channels of the first part, as floats.
pub(super) fn floats(input: &mut Input, channels: u32) -> Vec<f32> {
    match input.read([0, 0], channels, Format::Float, 1 << 20) {
        Ok(Pixels::Float(pixels)) => pixels,
        other => panic!("not floats: {other:?}"),
    }
}

/// The first channels of the first part, as bytes.
pub(super) fn bytes(input: &mut Input, channels: u32) -> Vec<u8> {
    match input.read([0, 0], channels, Format::Byte, 1 << 20) {
        Ok(Pixels::Byte(pixels)) => pixels,
        other => panic!("not bytes: {other:?}"),
    }
}
