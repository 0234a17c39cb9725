//! Texture coordinates for cages without them: charts that are flattened by least squares conformal maps and packed
//! into the unit square, after Lévy, Petitjean, Ray and Maillot 2002.
//!
//! [`atlas`] cuts the cage into charts (`segment`), each a disk that a conformal map (`conformal`) takes to the plane
//! one to one (`check`) and without much stretch, and packs them (`pack`) at one density of texels. All faces have
//! coordinates, those of holes too.
//!
//! What is one to one are the cage's own polygons. Their coordinates must stay linear within each face: with
//! [`FaceVaryingInterpolation::All`], which [`Atlas::put_on`] sets. Rules that smooth them would round the charts' outlines.

mod cage;
mod chart;
mod check;
mod conformal;
mod pack;
mod segment;
#[cfg(test)]
mod tests;

use cage::Cage;
use chart::Flat;
use check::is_one_to_one;
use pack::{Place, Square};
use segment::Cutter;

use crate::error::Fault;
use crate::math::{DVec2, Vec2};
use crate::mesh::{ControlMesh, FaceVaryingInterpolation, Interpolation, Primvar};

/// How often charts that rounding spoils are cut further.
const ROUNDS: usize = 16;
/// The most texels across a picture.
const MOST_TEXELS: u32 = 1 << 16;

/// What an atlas is to be like.
#[derive(Debug, Clone, PartialEq)]
pub struct AtlasOptions {
    /// The primvar's name.
    pub primvar: String,
    /// Texels across the square picture that the charts are for: 1 to 65536.
    pub resolution: u32,
    /// Texels between charts at least, and half as many along the picture's sides.
    pub margin: f64,
    /// Lengths in a chart become at most this many times as long or as short as those in the whole chart do; above 1.
    /// Less makes more charts.
    pub most_stretch: f64,
}

impl Default for AtlasOptions {
    fn default() -> Self {
        Self {
            primvar: "st".to_owned(),
            resolution: 1024,
            margin: 4.0,
            most_stretch: 2.0,
        }
    }
}

impl AtlasOptions {
    /// Checks that all numbers are in their ranges.
    ///
    /// # Errors
    /// The first one that is not.
    pub fn check(&self) -> Result<(), Fault> {
        let Self {
            resolution,
            margin,
            most_stretch,
            ..
        } = self;
        if !(1..=MOST_TEXELS).contains(resolution) {
            let message = format!("a resolution of {resolution} texels");
            return Err(Fault::new(message).advise(format!("ask for 1 to {MOST_TEXELS}")));
        }
        if !(0.0..f64::from(*resolution)).contains(margin) {
            let message = format!("a margin of {margin} texels in {resolution}");
            return Err(Fault::new(message).advise("ask for 0 to fewer than the resolution"));
        }
        if !(*most_stretch > 1.0 && most_stretch.is_finite()) {
            let message = format!("a stretch of at most {most_stretch}");
            return Err(Fault::new(message).advise("ask for a number above 1"));
        }
        Ok(())
    }
}

/// Texture coordinates of a cage, and its charts.
#[derive(Debug, Clone, PartialEq)]
pub struct Atlas {
    /// Two components, face-varying with indices, within the unit square. Corners of a vertex have the same element
    /// where no seam is between them.
    pub coordinates: Primvar,
    /// The chart of each face.
    pub charts: Vec<u32>,
    /// How many charts there are.
    pub chart_count: u32,
    /// The part of the square that the charts fill, 0 to 1.
    pub filled: f64,
}

impl Atlas {
    /// Gives the cage these coordinates, in place of others of that name, and keeps face-varying primvars linear in
    /// each face.
    pub fn put_on(self, mesh: &mut ControlMesh) {
        mesh.primvars.retain(|p| p.name != self.coordinates.name);
        mesh.primvars.push(self.coordinates);
        mesh.face_varying = FaceVaryingInterpolation::All;
    }
}

/// Makes texture coordinates for a cage's polygons, by its points at the first motion key. The same cage and options
/// give the same bits.
///
/// Faces without a shape (no area, or a vertex twice) are charts of their own, as regular polygons.
///
/// # Errors
/// A mesh that is not valid or has no faces, options out of range, or more charts than fit with their margins.
pub fn atlas(mesh: &ControlMesh, options: &AtlasOptions) -> Result<Atlas, Fault> {
    options.check()?;
    mesh.validate()?;
    if mesh.face_count() == 0 {
        return Err(Fault::new("the mesh has no faces").advise("give a mesh with faces"));
    }
    let cage = Cage::new(mesh);
    let mut cutter = Cutter::new(&cage, options.most_stretch, mesh.left_handed);
    let mut charts = cutter.charts();
    let square = Square::new(options.resolution, options.margin);
    for _ in 0..ROUNDS {
        let places = square.pack(&mut charts).ok_or_else(|| {
            let (count, margin, across) = (charts.len(), options.margin, options.resolution);
            Fault::new(format!(
                "{count} charts with {margin} texels between them do not fit into {across} x {across} texels"
            ))
            .advise("ask for a higher --resolution or a smaller --margin")
        })?;
        let mut good = true;
        let mut next = Vec::with_capacity(charts.len());
        for (chart, place) in charts.iter().zip(&places) {
            let rounded = rounded(chart, place);
            let rounded: Vec<DVec2> = rounded.iter().map(|p| p.as_dvec2()).collect();
            if is_one_to_one(&cage, chart, &rounded, mesh.left_handed) {
                next.push(chart.clone());
            } else {
                good = false;
                next.extend(cutter.cut_further(chart));
            }
        }
        if good {
            return Ok(assembled(mesh, &cage, &charts, &places, options));
        }
        charts = next;
    }
    Err(
        Fault::new("its faces are too different in size for one picture: coordinates cannot tell their corners apart")
            .advise("split the mesh, or remove faces that are next to nothing"),
    )
}

/// A chart's coordinates by node, in the precision that they are given in.
fn rounded(chart: &Flat, place: &Place) -> Vec<Vec2> {
    let put = |p: &DVec2| (place.scale * *p + place.offset).as_vec2();
    chart.places.iter().map(put).collect()
}

fn assembled(
    mesh: &ControlMesh,
    cage: &Cage,
    charts: &[Flat],
    places: &[Place],
    options: &AtlasOptions,
) -> Atlas {
    let mut chart_of = vec![0; mesh.face_count()];
    let mut indices = vec![0; mesh.face_vertex_indices.len()];
    let mut values = Vec::new();
    let mut filled = 0.0;
    for ((number, chart), place) in (0..).zip(charts).zip(places) {
        let first = values.len() as u32 / 2;
        values.extend(rounded(chart, place).iter().flat_map(|p| p.to_array()));
        for (face, nodes) in chart.disk.face_nodes() {
            chart_of[face as usize] = number;
            for (corner, node) in cage.topology.corners(face).zip(nodes) {
                indices[corner as usize] = first + node;
            }
        }
        let border = &chart.disk.border;
        let at = |i: usize| chart.places[border[i % border.len()] as usize];
        let twice: f64 = (0..border.len()).map(|i| at(i).perp_dot(at(i + 1))).sum();
        filled += 0.5 * twice.abs() * place.scale * place.scale;
    }
    Atlas {
        coordinates: Primvar {
            name: options.primvar.clone(),
            interpolation: Interpolation::FaceVarying,
            width: 2,
            values,
            indices: Some(indices),
        },
        charts: chart_of,
        chart_count: charts.len() as u32,
        filled,
    }
}
