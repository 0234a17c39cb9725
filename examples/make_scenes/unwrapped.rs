//! A Ptex file as an image for an atlas: what the file is at the middle of each texel that a face covers. Around charts
//! some texels more can be filled from their borders, as texture painters do.

use std::path::Path;

use relievo::Result;
use relievo::error::Fault;
use relievo::image::{
    Channel, ChannelFormat, Compression, ImageSource, Part, Picture, PtexFilter, PtexOptions,
    PtexTexture, write_exr,
};
use relievo::math::{Area, DVec2, Vec2, Vec3};
use relievo::mesh::{ControlMesh, Primvar, PtexFace, ptex_faces};
use relievo::scene::ColorSpace;
use relievo_ptex::Cache;

/// `size` x `size` texels of a Ptex file, by the texture coordinates of a scene's gourd; `margin` texels around charts
/// are filled, the others are 0.
pub(crate) fn write(scene: &str, ptex: &str, [size, margin]: [usize; 2], path: &str) -> Result<()> {
    let mesh = super::gourd::mesh(scene)?;
    let lacks = || Fault::new("the gourd has no primvar st: make its atlas first").in_file(scene);
    let st = mesh.primvar("st").ok_or_else(lacks)?;
    let options = PtexOptions {
        filter: PtexFilter::default(),
        first_channel: 0,
        color_space: ColorSpace::Auto,
    };
    let image = ImageSource::File(ptex.into());
    let reader = PtexTexture::open(&image, &Cache::default())?;
    let texture = PtexTexture::new(reader, &options)?;
    let colours = texture.reader().map_or(1, |reader| reader.channels());

    let mut texels: Vec<Option<Vec3>> = vec![None; size * size];
    for (number, face) in (0..).zip(ptex_faces(&mesh)) {
        let corners = corners(&mesh, st, &face).map(|p| p * size as f64);
        let (low, high) = corners[1..]
            .iter()
            .fold((corners[0], corners[0]), |(low, high), p| {
                (low.min(*p), high.max(*p))
            });
        for y in low.y as usize..(high.y.ceil() as usize).min(size) {
            for x in low.x as usize..(high.x.ceil() as usize).min(size) {
                let Some(uv) = parameters(corners, DVec2::new(x as f64 + 0.5, y as f64 + 0.5))
                else {
                    continue;
                };
                // Row 0 is on top, where t is 1.
                texels[(size - 1 - y) * size + x] =
                    Some(texture.eval(number, uv, &Area::POINT).truncate());
            }
        }
    }
    if let Some(fault) = texture.fault() {
        return Err(fault.clone().into());
    }
    for _ in 0..margin {
        texels = grown(&texels, size);
    }
    let values = texels.iter().map(|t| t.unwrap_or(Vec3::ZERO).to_array());
    let picture = Picture {
        width: size as u32,
        height: size as u32,
        display_window: (size as u32, size as u32, 0, 0),
        parts: vec![Part {
            name: String::new(),
            channels: (["R", "G", "B"].into_iter().take(colours))
                .map(|name| Channel {
                    name: name.into(),
                    format: ChannelFormat::Float,
                })
                .collect(),
            pixels: values.flat_map(|v| v.into_iter().take(colours)).collect(),
        }],
        metadata: Vec::new(),
        tile: None,
        compression: Compression::Zips,
    };
    write_exr(&super::with_folder(Path::new(path))?, &picture)
}

/// Where the corners of a Ptex face lie in the atlas: (0, 0), (1, 0), (1, 1) and (0, 1) of its parameters.
fn corners(mesh: &ControlMesh, st: &Primvar, face: &PtexFace) -> [DVec2; 4] {
    let range = mesh
        .faces()
        .nth(face.face as usize)
        .expect("a face of the mesh");
    let n = range.len();
    let at = |i: usize| {
        let st = st.get(range.start + i % n);
        DVec2::new(st[0].into(), st[1].into())
    };
    match face.corner {
        None => [0, 1, 2, 3].map(at),
        Some(corner) => {
            let corner = corner as usize;
            let middle = (0..n).map(at).sum::<DVec2>() / n as f64;
            let half = |i: usize| 0.5 * (at(corner) + at(i));
            [at(corner), half(corner + 1), middle, half(corner + n - 1)]
        }
    }
}

/// The parameters of a point of a bilinear patch, by Newton's method; none if it lies outside.
fn parameters([a, b, c, d]: [DVec2; 4], p: DVec2) -> Option<Vec2> {
    let (du, dv, both) = (b - a, d - a, a - b + c - d);
    let off = |uv: DVec2| a + uv.x * du + uv.y * dv + uv.x * uv.y * both - p;
    let mut uv = DVec2::splat(0.5);
    for _ in 0..24 {
        let (along_u, along_v) = (du + uv.y * both, dv + uv.x * both);
        let (area, off) = (along_u.perp_dot(along_v), off(uv));
        uv -= DVec2::new(off.perp_dot(along_v), along_u.perp_dot(off)) / area;
        // There is another solution beyond the patch.
        uv = uv.clamp(DVec2::splat(-0.1), DVec2::splat(1.1));
    }
    let inside = uv.cmpge(DVec2::splat(-1e-9)).all() && uv.cmple(DVec2::splat(1.0 + 1e-9)).all();
    (inside && off(uv).length() < 1e-6).then(|| uv.as_vec2())
}

/// Texels that have none take the mean of those around them that do.
fn grown(texels: &[Option<Vec3>], size: usize) -> Vec<Option<Vec3>> {
    let near = |i: usize| i.saturating_sub(1)..(i + 2).min(size);
    (0..size * size)
        .map(|at| {
            let (x, y) = (at % size, at / size);
            let around = near(y).flat_map(|y| near(x).map(move |x| y * size + x));
            let known: Vec<Vec3> = around.filter_map(|i| texels[i]).collect();
            let mean = known.iter().sum::<Vec3>() / known.len() as f32;
            texels[at].or((!known.is_empty()).then_some(mean))
        })
        .collect()
}
