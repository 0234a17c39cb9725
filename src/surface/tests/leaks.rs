//! Rays that must not escape: from inside of closed, creased, displaced shapes of mixed rates, near the origin and far
//! from it, towards vertices, towards points of edges, along axes, and anywhere. For every way to trace.

use std::fmt;

use rayon::prelude::*;

use super::shapes::Random;
use super::*;
use crate::math::Ray;

/// A closed surface, and a point within.
struct Case {
    name: String,
    diced: Arc<Diced>,
    inside: Vec3,
}

/// How many rays escaped.
pub(crate) struct Escapes {
    /// Of those that aim at a micro-vertex to the bit, as far as rays can.
    pub(crate) at_vertices: usize,
    /// Of all others.
    pub(crate) elsewhere: usize,
    /// Rays of both kinds.
    pub(crate) rays: [usize; 2],
}

impl fmt::Display for Escapes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [aimed, others] = self.rays;
        write!(
            f,
            "{} of {aimed} rays at vertices and {} of {others} others escaped",
            self.at_vertices, self.elsewhere
        )
    }
}

/// Sends at least so many rays, one shape after the other: `build` makes what is traced of a shape, `met` says whether
/// a ray from within meets it.
pub(crate) fn escapes<T>(
    rays: usize,
    build: impl Fn(Arc<Diced>) -> T + Sync,
    met: impl Fn(&T, &Ray) -> bool + Sync,
) -> Escapes {
    let cases = cases();
    let each = rays.div_ceil(cases.len()).next_multiple_of(4);
    let found = cases.par_iter().map(|case| {
        let traced = build(Arc::clone(&case.diced));
        let mut random = Random(7);
        let mut escaped = [0, 0];
        for i in 0..each {
            if !met(&traced, &ray(&case.diced, case.inside, i, &mut random)) {
                escaped[usize::from(!aims_at_vertex(i))] += 1;
            }
        }
        if escaped != [0, 0] {
            println!("{}: {escaped:?} of {each} rays escaped", case.name);
        }
        escaped
    });
    let [at_vertices, elsewhere] = found.reduce(|| [0, 0], |a, b| [a[0] + b[0], a[1] + b[1]]);
    Escapes {
        at_vertices,
        elsewhere,
        rays: [1, 3].map(|quarters| quarters * cases.len() * each / 4),
    }
}

/// Sends at least so many rays at all times, from one solid after the other: `build` makes what is traced of a surface, and
/// `met` says whether the ray of a number meets it. Gives how many escaped.
pub(crate) fn lost<T>(
    rays: usize,
    solids: Vec<Solid>,
    build: impl Fn(&Arc<Surface>, &Rates) -> T + Sync,
    met: impl Fn(&T, Ray, usize, &mut Random) -> bool + Sync,
) -> usize {
    let each = rays.div_ceil(solids.len());
    let of_solid = |solid: Solid| {
        let Solid {
            name,
            surface,
            inside,
        } = solid;
        let (rates, surface) = (mixed(&surface), Arc::new(surface));
        let (traced, diced) = (build(&surface, &rates), Diced::new(&surface, &rates));
        let mut random = Random(7);
        let mut lost = 0;
        for i in 0..each {
            let mut ray = ray(&diced, inside, i, &mut random);
            ray.time = if i % 3 == 0 { 0.0 } else { random.next() };
            lost += usize::from(!met(&traced, ray, i, &mut random));
        }
        if lost > 0 {
            println!("{name}: {lost} of {each} rays escaped");
        }
        lost
    };
    solids.into_par_iter().map(of_solid).sum()
}

/// All solids, still and moving.
pub(crate) fn still_and_moving() -> Vec<Solid> {
    [false, true].into_iter().flat_map(solids).collect()
}

/// Those that are not displaced by vectors.
pub(crate) fn along_normals() -> Vec<Solid> {
    let mut solids = still_and_moving();
    solids.retain(|solid| !matches!(solid.surface.displacement(), Displacement::Vector(..)));
    solids
}

fn cases() -> Vec<Case> {
    let diced = |solid: Solid| Case {
        name: solid.name,
        diced: Arc::new(Diced::new(&solid.surface, &mixed(&solid.surface))),
        inside: solid.inside,
    };
    solids(false).into_iter().map(diced).collect()
}

/// A closed displaced surface that is not diced yet, and a point within.
pub(crate) struct Solid {
    pub(crate) name: String,
    pub(crate) surface: Surface,
    pub(crate) inside: Vec3,
}

/// Closed, creased, displaced shapes near the origin and far from it; if they move, the point stays within.
pub(crate) fn solids(moving: bool) -> Vec<Solid> {
    let mut solids = Vec::new();
    for (shape, base) in closed() {
        // Rays start in the middle of the solid: of the tube, for a torus.
        let centre = if shape.contains("torus") {
            Vec3::X
        } else {
            Vec3::ZERO
        };
        for (kind, displacement) in displacements(0.05) {
            for offset in [0.0, 2e5] {
                let scale = if offset > 0.0 { 40.0 } else { 1.0 };
                let mut placed = base.clone().mapped(|p| scale * p + offset);
                if moving {
                    placed = placed.moving(|p| p + 0.05 * scale * Vec3::Y);
                }
                solids.push(Solid {
                    name: format!("{shape}, {kind}, at {offset}, moving: {moving}"),
                    surface: surface(placed, displacement.clone()),
                    inside: scale * centre + offset,
                });
            }
        }
    }
    solids
}

fn aims_at_vertex(i: usize) -> bool {
    i.is_multiple_of(4)
}

/// The `i`th ray from `inside` of a closed surface.
pub(crate) fn ray(diced: &Diced, inside: Vec3, i: usize, random: &mut Random) -> Ray {
    let positions = &diced.positions()[0];
    let any = |random: &mut Random| {
        let at = random.next() * positions.len() as f32;
        positions[(at as usize).min(positions.len() - 1)]
    };
    let corners = |random: &mut Random| {
        let at = f64::from(random.next()) * diced.triangles() as f64;
        diced
            .corners((at as u64).min(diced.triangles() - 1))
            .map(|v| positions[v as usize])
    };
    let target = match i % 4 {
        _ if aims_at_vertex(i) => any(random),
        1 => {
            // Of snapped vertices two may be one.
            let (a, b) = loop {
                let [a, b, _] = corners(random);
                if a != b {
                    break (a, b);
                }
            };
            a.lerp(b, 0.01 + 0.98 * random.next())
        }
        2 => inside + [Vec3::X, Vec3::Y, Vec3::Z][i / 4 % 3] * [1.0, -1.0][i / 12 % 2],
        _ => inside + random.direction(),
    };
    let direction = target - inside;
    let direction = if direction == Vec3::ZERO {
        Vec3::X
    } else {
        direction
    };
    Ray::new(inside, direction, 0.0)
}
