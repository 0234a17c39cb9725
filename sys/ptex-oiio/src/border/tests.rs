//! The border as C sees it.

use std::ffi::CString;

use relievo_ptex::{FaceInfo, Format, Writer};

use super::*;

/// A buffer for messages, as the other side has one.
struct Buffer([c_char; 256]);

impl Buffer {
    fn new() -> Self {
        Self([1; 256])
    }

    fn text(&self) -> &str {
        // SAFETY: c_char is a byte of either sign, and any byte is one of the other.
        let bytes = unsafe { slice::from_raw_parts(self.0.as_ptr().cast(), self.0.len()) };
        let text = CStr::from_bytes_until_nul(bytes).expect("a terminated message");
        text.to_str().expect("a message in UTF-8")
    }
}

/// A file with a face of 64 x 32 texels, whose value is their place.
fn bytes() -> Vec<u8> {
    let mut writer = Writer::new(Format::new(MeshType::Quad, DataType::U16, 1), 1).unwrap();
    let info = FaceInfo {
        res: Res { ulog2: 6, vlog2: 5 },
        neighbours: [None; 4],
        constant: false,
        has_edits: false,
        constant_neighbourhood: false,
        subface: false,
    };
    let texels: Vec<u8> = (0..64 * 32_u16).flat_map(u16::to_le_bytes).collect();
    writer.face(0, &info, &texels).unwrap();
    writer.set_meta("key", MetaValue::I8(vec![-7, 7])).unwrap();
    writer.bytes().unwrap()
}

fn open(bytes: &[u8], buffer: &mut Buffer) -> (c_int, *mut PtexBorderFile) {
    let name = CString::new("made.ptx").unwrap();
    let mut file = ptr::null_mut();
    // SAFETY: all pointers are to what lives on, with its length.
    let code = unsafe {
        ptex_border_open(
            name.as_ptr(),
            bytes.as_ptr(),
            bytes.len(),
            &raw mut file,
            buffer.0.as_mut_ptr(),
            buffer.0.len(),
        )
    };
    (code, file)
}

/// Texels of face 0.
fn read(file: *mut PtexBorderFile, level: u32, area: [u32; 4], out: &mut [u16]) -> (c_int, Buffer) {
    let mut buffer = Buffer::new();
    let [x, y, width, height] = area;
    // SAFETY: the file is open, and the slices are passed with their lengths.
    let code = unsafe {
        ptex_border_read(
            file,
            0,
            level,
            x,
            y,
            width,
            height,
            out.as_mut_ptr().cast(),
            size_of_val(out),
            buffer.0.as_mut_ptr(),
            buffer.0.len(),
        )
    };
    (code, buffer)
}

#[test]
fn all_threads_may_read_at_once() {
    let (code, file) = open(&bytes(), &mut Buffer::new());
    assert_eq!(code, 0);
    let address = file as usize;
    std::thread::scope(|scope| {
        for thread in 0..8_u32 {
            scope.spawn(move || {
                let file = address as *mut PtexBorderFile;
                for i in 0..200 {
                    let [x, y] = [(thread * 7 + i) % 60, (thread * 5 + i) % 30];
                    let mut out = [0; 8];
                    let (code, _) = read(file, 0, [x, y, 4, 2], &mut out);
                    assert_eq!(code, 0);
                    let place = |i: u32| ((y + i / 4) * 64 + x + i % 4) as u16;
                    assert_eq!(out, [0, 1, 2, 3, 4, 5, 6, 7].map(place));
                    // A reduction: the mean of four texels.
                    let mut out = [0];
                    let (code, _) = read(file, 1, [x / 2, y / 2, 1, 1], &mut out);
                    assert_eq!(code, 0);
                    assert_eq!(u32::from(out[0]), (y / 2 * 2) * 64 + x / 2 * 2 + 32);
                }
            });
        }
    });
    // SAFETY: no one uses it any more.
    unsafe { ptex_border_close(file) };
}

#[test]
fn what_is_not_there_is_told() {
    let (_, file) = open(&bytes(), &mut Buffer::new());
    let misuse = sys::PTEX_BORDER_MISUSE as c_int;
    let mut out = [0; 4];
    for area in [
        [63, 0, 4, 1],
        [0, 32, 4, 1],
        [0, 0, 0, 4],
        [u32::MAX, 0, 4, 1],
    ] {
        let (code, buffer) = read(file, 0, area, &mut out);
        assert_eq!(code, misuse, "{area:?}");
        assert!(buffer.text().contains("face 0"), "{}", buffer.text());
    }
    let (code, _) = read(file, 0, [0, 0, 8, 1], &mut out);
    assert_eq!(code, misuse, "another size");
    let (code, buffer) = read(file, 7, [0, 0, 1, 1], &mut out);
    assert_eq!(code, sys::PTEX_BORDER_ABSENT as c_int);
    assert!(buffer.text().contains("no level 7"), "{}", buffer.text());
    assert_eq!(out, [0; 4]);
    let (code, _) = read(ptr::null_mut(), 0, [0, 0, 4, 1], &mut out);
    assert_eq!(code, misuse);
    // SAFETY: no one uses it any more; and null is allowed.
    unsafe {
        ptex_border_close(file);
        ptex_border_close(ptr::null_mut());
    }
}

#[test]
fn headers_are_told() {
    let (_, file) = open(&bytes(), &mut Buffer::new());
    let mut info = PtexBorderInfo::default();
    // SAFETY: the file is open until the end of the test, and so is what the pointers in `info` lead to.
    unsafe {
        assert_eq!(ptex_border_info(file, &raw mut info, ptr::null_mut(), 0), 0);
        assert_eq!(CStr::from_ptr(info.mesh_type), c"quad");
        assert_eq!(CStr::from_ptr(info.v_border), c"clamp");
        let meta = slice::from_raw_parts(info.meta, info.meta_count);
        assert_eq!(meta.len(), 1);
        let key = slice::from_raw_parts(meta[0].key.cast::<u8>(), meta[0].key_size);
        assert_eq!(key, b"key");
        let numbers = slice::from_raw_parts(meta[0].data.cast::<i8>(), meta[0].count);
        assert_eq!(numbers, [-7, 7]);
        ptex_border_close(file);
    }
    assert_eq!(
        [info.type_, info.channels, info.faces, info.has_edits],
        [sys::PTEX_BORDER_UINT16, 1, 1, 0]
    );
    assert_eq!(info.alpha_channel, -1);
}

#[test]
fn no_cut_file_is_opened() {
    let bytes = bytes();
    let mut buffer = Buffer::new();
    for length in (0..bytes.len()).step_by(7) {
        let (code, file) = open(&bytes[..length], &mut buffer);
        assert!(file.is_null() == (code != 0), "{length}");
        if code != 0 {
            assert!(buffer.text().starts_with("made.ptx: "), "{}", buffer.text());
        }
        // SAFETY: it is open and no one else's, or null.
        unsafe { ptex_border_close(file) };
    }
}

#[test]
fn panics_become_messages_and_long_ones_are_cut() {
    let mut buffer = Buffer::new();
    let (message, size) = (buffer.0.as_mut_ptr(), buffer.0.len());
    let code = guarded(message, size, || panic!("{}", "x".repeat(1000)));
    assert_eq!(code, sys::PTEX_BORDER_FAILED as c_int);
    assert!(buffer.text().starts_with("a bug of the reader: xxx"));
    assert_eq!(buffer.text().len(), 255);
    assert_eq!(guarded(ptr::null_mut(), 0, || panic!()), code);
}
