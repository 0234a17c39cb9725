//! The chain mail: a tile of rings, and a cloth that hangs in folds.

use std::f32::consts::TAU;

use relievo::math::{Vec2, Vec3};

use crate::usd::Mesh;

/// Rings along a side of the tile, an even number: every other row leans the other way.
const SIDE: usize = 4;
/// Distance of rings and of rows, in radii of a ring.
const PITCH: f32 = 1.25;
/// How far rings lean along their row, radians. At this and the pitch rings stay farthest from each other: half a radius
/// from wire to wire.
const LEAN: f32 = 0.58;
/// Radius of the wire, in radii of a ring.
const WIRE: f32 = 0.18;
/// Quads around a ring and around its wire.
const AROUND: usize = 24;
const SECTION: usize = 8;

/// Faces along a side of the cloth.
const FACES: usize = 12;
/// Side of the cloth.
const CLOTH: f32 = 10.0;

/// A tile of European four-in-one: each ring runs through two of the row above and two of the row below. A ring stands in the
/// tile that its middle is in, once. z has the scale of x and y.
pub(crate) fn tile() -> String {
    let mut mesh = Mesh::default();
    for (row, column) in (0..SIDE).flat_map(|row| (0..SIDE).map(move |column| (row, column))) {
        let odd = row % 2 == 1;
        let shifted = column as f32 + if odd { 0.75 } else { 0.25 };
        let middle = PITCH * Vec3::new(shifted, row as f32 + 0.5, 0.0);
        let (sine, cosine) = if odd { -LEAN } else { LEAN }.sin_cos();
        let (x, normal) = (Vec3::new(cosine, 0.0, -sine), Vec3::new(sine, 0.0, cosine));
        let first = mesh.points.len();
        for i in 0..AROUND {
            let (b, a) = (TAU * i as f32 / AROUND as f32).sin_cos();
            let out = a * x + b * Vec3::Y;
            for j in 0..SECTION {
                let (up, along) = (TAU * j as f32 / SECTION as f32).sin_cos();
                let at = middle + out + WIRE * (along * out + up * normal);
                mesh.points.push(at / (PITCH * SIDE as f32));
                let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                let point = |(i, j)| first + i % AROUND * SECTION + j % SECTION;
                mesh.faces.push(corners.map(point).to_vec());
            }
        }
    }
    let doc = format!(
        "{} rings of mail in {} quads: a tile for RelievoShellAPI.",
        SIDE * SIDE,
        mesh.faces.len()
    );
    mesh.text("Tile", &doc, "none")
}

/// The cage: rows of the cloth keep their length, and swing the more the lower they hang. Its front looks along z.
pub(crate) fn cloth() -> String {
    let mut mesh = Mesh::default();
    for row in 0..=FACES {
        let low = 1.0 - row as f32 / FACES as f32;
        // Direction of the row at a place, from left to right.
        let swing = |u: f32| {
            let wave = (TAU * (2.2 * u + 0.08 * low)).cos() + 0.35 * (TAU * (3.6 * u + 0.3)).sin();
            (0.45 + 0.5 * low) * wave
        };
        const STEPS: usize = 40;
        let step = CLOTH / (FACES * STEPS) as f32;
        let mut at = Vec2::ZERO;
        let mut places = vec![at];
        for place in 0..FACES * STEPS {
            at += step * Vec2::from_angle(swing((place as f32 + 0.5) / (FACES * STEPS) as f32));
            places.push(at);
        }
        let middle = places[FACES * STEPS / 2];
        for column in 0..=FACES {
            let place = places[column * STEPS] - middle;
            let forward = place.y + 0.9 * low * low;
            mesh.points
                .push(Vec3::new(place.x, CLOTH * (1.0 - low), forward));
        }
    }
    for (row, column) in (0..FACES).flat_map(|row| (0..FACES).map(move |column| (row, column))) {
        let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[a, b]| [column + a, row + b]);
        mesh.faces
            .push(corners.map(|[c, r]| r * (FACES + 1) + c).to_vec());
        mesh.st
            .extend(corners.map(|c| Vec2::from(c.map(|c| c as f32)) / FACES as f32));
    }
    let doc = "A square cloth that hangs in folds.";
    mesh.text("Cloth", doc, "catmullClark")
}
