//! The furry knot: a cage around a trefoil, and a tile of hair for it.

use std::f32::consts::TAU;

use relievo::math::{Vec2, Vec3};

use crate::SEED;
use crate::noise::hash;
use crate::usd::Mesh;

/// Strands along a side of the tile.
const SIDE: i32 = 13;
/// Pieces of a strand: all but the last are two triangles.
const PIECES: usize = 6;
/// Where strands gather, in each tile.
const LOCKS: i32 = 5;

/// Faces of the cage along the knot and around it.
const ALONG: usize = 48;
const AROUND: usize = 8;
/// Of the knot's rope.
const RADIUS: f32 = 0.93;

/// A tile of strands: ribbons of flat triangles that taper, lean along s and gather in locks. Strands stand in a lattice that
/// is shaken, and their roots are below the surface.
pub(crate) fn tile() -> String {
    let mut mesh = Mesh::default();
    for (j, i) in (0..SIDE).flat_map(|j| (0..SIDE).map(move |i| (j, i))) {
        let random = |what: u32| hash(SEED.wrapping_add(what), i, j);
        let shaken = Vec2::new(i as f32 + random(0), j as f32 + random(1));
        let root = shaken / SIDE as f32;
        let gather = 0.6 * towards_lock(root);
        let lean = Vec2::from_angle(0.9 * (random(2) - 0.5)) * (0.35 + 0.45 * random(3));
        let top = 0.6 + 0.4 * random(4);
        let across = Vec2::from_angle(TAU * random(5)) * (0.011 + 0.009 * random(6));
        let spine = |u: f32| {
            let at = root + lean * u.powf(1.7) + gather * u * u;
            at.extend((top + 0.08) * u * (1.15 - 0.15 * u) - 0.08)
        };
        let first = mesh.points.len();
        for piece in 0..PIECES {
            let u = piece as f32 / PIECES as f32;
            let half = (across * (1.0 - u).powf(0.7)).extend(0.0);
            mesh.points.extend([spine(u) - half, spine(u) + half]);
            let [a, b] = [first + 2 * piece, first + 2 * piece + 1];
            mesh.faces.push(vec![a, b, a + 2]);
            if piece + 1 < PIECES {
                mesh.faces.push(vec![b, b + 2, a + 2]);
            }
        }
        mesh.points.push(spine(1.0));
    }
    let doc = format!(
        "{} strands of fur in {} triangles: a tile for RelievoShellAPI.",
        SIDE * SIDE,
        mesh.faces.len()
    );
    mesh.text("Tile", &doc, "none")
}

/// From a place of the tile to the nearest lock, of this tile or of one beside it.
fn towards_lock(from: Vec2) -> Vec2 {
    let places = (0..LOCKS).flat_map(|lock| {
        let middle = Vec2::new(hash(SEED, lock, 91), hash(SEED, lock, 92));
        (0..9)
            .map(move |tile| middle + Vec2::new((tile % 3) as f32, (tile / 3) as f32) - 1.0 - from)
    });
    let nearer = |a: Vec2, b: Vec2| if b.length() < a.length() { b } else { a };
    places.reduce(nearer).unwrap_or_default()
}

/// The cage: rings of points at even distances along the knot, in a frame that turns as little as it can. s runs along the
/// knot, t around it, both from 0 to 1.
pub(crate) fn body() -> String {
    let frames = frames();
    let mut mesh = Mesh::default();
    let mut colors = Vec::new();
    // The limit of a ring of points is a ring that is smaller by this.
    let shrinks = (4.0 + 2.0 * (TAU / AROUND as f32).cos()) / 6.0;
    for (i, [at, x, y]) in frames.iter().enumerate() {
        for j in 0..AROUND {
            let (sine, cosine) = (TAU * j as f32 / AROUND as f32).sin_cos();
            let out = *x * cosine + *y * sine;
            mesh.points.push(*at + RADIUS / shrinks * out);
            // Bands around the rope that fade below it.
            let band = (0.5 + 1.4 * (6.0 * TAU * i as f32 / ALONG as f32).cos()).clamp(0.0, 1.0);
            let dark = band * (0.7 + 0.3 * out.y);
            colors.push(Vec3::new(0.83, 0.62, 0.36).lerp(Vec3::new(0.2, 0.075, 0.025), dark));
        }
    }
    for (i, j) in (0..ALONG).flat_map(|i| (0..AROUND).map(move |j| (i, j))) {
        let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
        let point = |(i, j)| i % ALONG * AROUND + j % AROUND;
        mesh.faces.push(corners.map(point).to_vec());
        let st = |(i, j)| Vec2::new(i as f32 / ALONG as f32, j as f32 / AROUND as f32);
        mesh.st.extend(corners.map(st));
    }
    mesh.colors = Some(("coat", colors));
    let doc = "A rope along a trefoil knot, with stripes.";
    mesh.text("Knot", doc, "catmullClark")
}

/// Places along the knot with two directions across it, x and y; the tangent, y and x are right-handed.
fn frames() -> Vec<[Vec3; 3]> {
    const STEPS: usize = 9600;
    let knot = |step: usize| {
        let a = TAU * (step % STEPS) as f32 / STEPS as f32;
        let out = 3.0 + 1.5 * (3.0 * a).cos();
        Vec3::new(
            out * (2.0 * a).cos(),
            1.5 * (3.0 * a).sin(),
            -out * (2.0 * a).sin(),
        )
    };
    let mut x = Vec3::Y;
    let mut lengths = vec![0.0];
    let steps: Vec<[Vec3; 3]> = (0..=STEPS)
        .map(|step| {
            let at = knot(step);
            let ahead = knot(step + 1) - at;
            let length = lengths[step] + ahead.length();
            lengths.push(length);
            let tangent = ahead.normalize();
            x = (x - x.dot(tangent) * tangent).normalize();
            [at, x, x.cross(tangent)]
        })
        .collect();
    // What is left to turn after one round is turned along all of it.
    let ([_, first, side], [_, last, _]) = (steps[0], steps[STEPS]);
    let left = -last.dot(side).atan2(last.dot(first));
    let whole = lengths[STEPS];
    (0..ALONG)
        .map(|i| {
            let share = i as f32 / ALONG as f32;
            let step = lengths.partition_point(|&l| l < share * whole);
            let [at, x, y] = steps[step];
            let (sine, cosine) = (left * share).sin_cos();
            [at, cosine * x + sine * y, cosine * y - sine * x]
        })
        .collect()
}
