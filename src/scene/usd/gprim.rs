//! UsdGeom's shapes without points: Cube, Sphere, Cylinder, Cone, Capsule, Plane, and the second versions of two.
//!
//! The round ones are exact: a profile turned around the axis is a rational quadratic patch (Piegl, Tiller, "The
//! NURBS Book", 1997, section 8.5), whose sharp edges are where the profile has corners. u runs once around, v along
//! the profile from the bottom up. A cube is a polygon mesh. Sizes are those of the frame: they do not move within it.

use std::f64::consts::FRAC_1_SQRT_2;
use std::sync::Arc;

use openusd::tf::Token;
use openusd::usd::Prim;

use super::walk::{Reader, State};
use crate::error::Fault;
use crate::math::{DVec2, DVec3, Vec3};
use crate::mesh::{ControlMesh, NurbsDirection, NurbsForm, NurbsPatch, Scheme};
use crate::scene::{Geometry, UnusablePrimvar};

/// The types that [`Reader::gprim`] knows.
pub(super) const TYPES: [&str; 8] = [
    "Cube",
    "Sphere",
    "Cylinder",
    "Cylinder_1",
    "Cone",
    "Capsule",
    "Capsule_1",
    "Plane",
];

impl Reader {
    /// The surface of such a prim; `None`, with a warning, if it has no size.
    pub(super) fn gprim(
        &mut self,
        prim: &Prim,
        names: &[Token],
        state: &State,
        type_name: &str,
    ) -> Result<Option<(Geometry, Vec<UnusablePrimvar>)>, Fault> {
        let path = prim.path().as_str().to_owned();
        let mut sizes = Vec::new();
        let mut size = |name: &'static str, otherwise: f64| {
            let size = self.number(prim, name).unwrap_or(otherwise);
            sizes.push((name, size));
            size
        };
        let profile = match type_name {
            "Cube" => {
                size("size", 2.0);
                None
            }
            "Plane" => {
                size("width", 2.0);
                size("length", 2.0);
                None
            }
            "Sphere" => Some(sphere(size("radius", 1.0))),
            "Cone" => Some(cone(size("radius", 1.0), size("height", 2.0))),
            "Cylinder" => {
                let radius = size("radius", 1.0);
                Some(cylinder([radius; 2], size("height", 2.0)))
            }
            "Cylinder_1" => {
                let radii = [size("radiusBottom", 1.0), size("radiusTop", 1.0)];
                Some(cylinder(radii, size("height", 2.0)))
            }
            "Capsule_1" => {
                let radii = [size("radiusBottom", 0.5), size("radiusTop", 0.5)];
                Some(capsule(radii, size("height", 1.0)))
            }
            _ => {
                let radius = size("radius", 0.5);
                Some(capsule([radius; 2], size("height", 1.0)))
            }
        };
        if let Some((name, size)) = sizes.iter().find(|(_, size)| !size.is_finite()) {
            return Err(Fault::new(format!("{name} is {size}")).advise("sizes are finite numbers"));
        }
        // A height of 0 leaves a capsule's two ends; an end of radius 0 is a point.
        let largest = |part: &str| {
            let of_kind = sizes.iter().filter(|(name, _)| name.starts_with(part));
            of_kind.map(|(_, size)| *size).reduce(f64::max)
        };
        let empty = sizes.iter().any(|(_, size)| *size < 0.0)
            || largest("radius").is_some_and(|r| r == 0.0)
            || (profile.is_none() && sizes.iter().any(|(_, size)| *size == 0.0));
        if empty {
            self.warn("shape without a size", || {
                format!("{path}: {}; it is left out", describe(&sizes))
            });
            return Ok(None);
        }
        let axis = self.word(prim, "axis").unwrap_or_else(|| "Z".into());
        let left_handed = self.word(prim, "orientation").as_deref() == Some("leftHanded");
        if let Some(profile) = profile {
            let mut patch = profile.turned(&axis);
            patch.left_handed = left_handed;
            patch.validate()?;
            let (primvars, unusable) =
                self.usable_primvars(prim, names, state, |p| patch.validate_primvar(p));
            patch.primvars = primvars;
            return Ok(Some((Geometry::Nurbs(Arc::new(patch)), unusable)));
        }
        let mut mesh = match *sizes.as_slice() {
            [(_, width), (_, length)] => plane(&axis, width, length),
            _ => cube(sizes.first().map_or(2.0, |(_, size)| *size)),
        };
        mesh.left_handed = left_handed;
        let (primvars, unusable) =
            self.usable_primvars(prim, names, state, |p| mesh.validate_primvar(p));
        mesh.primvars = primvars;
        Ok(Some((Geometry::Mesh(Arc::new(mesh)), unusable)))
    }
}

fn describe(sizes: &[(&str, f64)]) -> String {
    let sizes: Vec<_> = sizes.iter().map(|(n, s)| format!("{n} is {s}")).collect();
    sizes.join(", ")
}

/// Rational quadratic arcs, each beginning where the one before ends: distance from the axis and height along it,
/// with the weights.
struct Profile {
    points: Vec<(DVec2, f64)>,
}

impl Profile {
    fn from(start: DVec2) -> Self {
        Self {
            points: vec![(start, 1.0)],
        }
    }

    fn line_to(mut self, end: DVec2) -> Self {
        let (start, _) = *self.points.last().expect("a profile has a start");
        if start == end {
            return self;
        }
        self.points.push((0.5 * (start + end), 1.0));
        self.points.push((end, 1.0));
        self
    }

    /// A circular arc whose tangents at both ends meet in `corner`; `weight` is the cosine of half its angle.
    fn arc_to(mut self, corner: DVec2, weight: f64, end: DVec2) -> Self {
        self.points.push((corner, weight));
        self.points.push((end, 1.0));
        self
    }

    /// Turned once around the axis of that name.
    fn turned(&self, axis: &str) -> NurbsPatch {
        // A full circle: four quarters, the corners of a square between them.
        const SQUARE: [[f64; 2]; 9] = [
            [1.0, 0.0],
            [1.0, 1.0],
            [0.0, 1.0],
            [-1.0, 1.0],
            [-1.0, 0.0],
            [-1.0, -1.0],
            [0.0, -1.0],
            [1.0, -1.0],
            [1.0, 0.0],
        ];
        let mut points = Vec::with_capacity(9 * self.points.len());
        let mut weights = Vec::with_capacity(points.capacity());
        for (at, weight) in &self.points {
            for (i, [x, y]) in SQUARE.into_iter().enumerate() {
                points.push(along(axis, DVec3::new(at.x * x, at.x * y, at.y)));
                weights.push(weight * if i % 2 == 1 { FRAC_1_SQRT_2 } else { 1.0 });
            }
        }
        let direction = |count: usize, form| NurbsDirection {
            order: 3,
            count,
            knots: arcs_knots(count),
            range: None,
            form,
        };
        NurbsPatch {
            u: direction(9, NurbsForm::Closed),
            v: direction(self.points.len(), NurbsForm::Open),
            points: vec![points],
            weights: Some(weights),
            ..NurbsPatch::default()
        }
    }
}

/// Knots of quadratic arcs end to end, each over a unit of the parameter.
fn arcs_knots(count: usize) -> Vec<f64> {
    let arcs = (count - 1) / 2;
    let inner = (0..=arcs).flat_map(|i| [i as f64; 2]);
    [0.0]
        .into_iter()
        .chain(inner)
        .chain([arcs as f64])
        .collect()
}

/// From the frame in which Z is the axis: the axes turn, so that handedness is kept.
fn along(axis: &str, p: DVec3) -> Vec3 {
    match axis {
        "X" => DVec3::new(p.z, p.x, p.y),
        "Y" => DVec3::new(p.y, p.z, p.x),
        _ => p,
    }
    .as_vec3()
}

fn sphere(r: f64) -> Profile {
    Profile::from(DVec2::new(0.0, -r))
        .arc_to(DVec2::new(r, -r), FRAC_1_SQRT_2, DVec2::new(r, 0.0))
        .arc_to(DVec2::new(r, r), FRAC_1_SQRT_2, DVec2::new(0.0, r))
}

fn cone(r: f64, height: f64) -> Profile {
    let h = 0.5 * height;
    Profile::from(DVec2::new(0.0, -h))
        .line_to(DVec2::new(r, -h))
        .line_to(DVec2::new(0.0, h))
}

fn cylinder([bottom, top]: [f64; 2], height: f64) -> Profile {
    let h = 0.5 * height;
    Profile::from(DVec2::new(0.0, -h))
        .line_to(DVec2::new(bottom, -h))
        .line_to(DVec2::new(top, h))
        .line_to(DVec2::new(0.0, h))
}

/// Two balls and the cone that touches both; one ball where it holds the other.
fn capsule([bottom, top]: [f64; 2], height: f64) -> Profile {
    let h = 0.5 * height;
    // The cone's normals climb by this sine.
    let sine = (bottom - top) / height;
    if height == 0.0 || sine.abs() >= 1.0 {
        let (r, at) = if bottom > top { (bottom, -h) } else { (top, h) };
        let mut ball = sphere(r);
        for (point, _) in &mut ball.points {
            point.y += at;
        }
        return ball;
    }
    let cosine = (1.0 - sine * sine).sqrt();
    let normal = DVec2::new(cosine, sine);
    let corner = |r: f64, side: f64| {
        // Half the angle from the pole to the normal; the tangents at both meet above the pole.
        let half = 0.5 * (side * sine).acos();
        (DVec2::new(r * half.tan(), side * r), half.cos())
    };
    let ((low, low_weight), (high, high_weight)) = (corner(bottom, -1.0), corner(top, 1.0));
    let (down, up) = (DVec2::new(0.0, -h), DVec2::new(0.0, h));
    Profile::from(down - DVec2::new(0.0, bottom))
        .arc_to(down + low, low_weight, down + bottom * normal)
        .line_to(up + top * normal)
        .arc_to(up + high, high_weight, up + DVec2::new(0.0, top))
}

fn polygons(points: Vec<Vec3>, faces: &[[u32; 4]]) -> ControlMesh {
    ControlMesh {
        scheme: Scheme::None,
        face_vertex_counts: vec![4; faces.len()],
        face_vertex_indices: faces.concat(),
        points: vec![points],
        ..ControlMesh::default()
    }
}

fn cube(size: f64) -> ControlMesh {
    let h = (0.5 * size) as f32;
    let side = |i: u32, bit: u32| if i >> bit & 1 == 1 { h } else { -h };
    polygons(
        (0..8)
            .map(|i| Vec3::new(side(i, 0), side(i, 1), side(i, 2)))
            .collect(),
        &[
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [3, 2, 6, 7],
            [1, 3, 7, 5],
            [2, 0, 4, 6],
        ],
    )
}

/// Width lies along X, length along Y, where the axis is Z; along Z and Y where it is X; X and Z where it is Y.
fn plane(axis: &str, width: f64, length: f64) -> ControlMesh {
    let at = |a: f64, b: f64| {
        let (w, l) = (0.5 * a * width, 0.5 * b * length);
        match axis {
            "X" => DVec3::new(0.0, l, -w),
            "Y" => DVec3::new(w, 0.0, -l),
            _ => DVec3::new(w, l, 0.0),
        }
        .as_vec3()
    };
    let corners = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
    polygons(corners.to_vec(), &[[0, 1, 2, 3]])
}
