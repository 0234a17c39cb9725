//! Shells: as near as asked for, and of one piece.

use std::collections::BTreeMap;

use super::*;
use crate::mesh::Crease;

/// What a face has along edge `k` of its grid: by sample in the edge's own direction.
fn along(shell: &Shell, base: &Patches, grid: &FaceGrid, k: u32) -> BTreeMap<u16, [u32; 8]> {
    let [nu, nv] = grid.size;
    let n = if k.is_multiple_of(2) { nu } else { nv };
    let segments = grid.segments[k as usize];
    (0..=n)
        .map(|x| {
            let (i, j) = [(x, 0), (nu, x), (nu - x, nv), (0, nv - x)][k as usize];
            let vertex = grid.vertex(i, j) as usize;
            let ShellPoint { position, normal } = shell.points(0)[vertex];
            let st = shell.st()[vertex];
            let sample = snapped(x, n, segments);
            let sample = if base.edge(grid.face, k).reversed {
                segments - sample
            } else {
                sample
            };
            let [x, y, z] = position.to_array();
            let [nx, ny, nz] = normal.to_array();
            (sample, [x, y, z, nx, ny, nz, st.x, st.y].map(f32::to_bits))
        })
        .collect()
}

#[test]
fn neighbours_have_the_same_corners() {
    for (name, base) in closed() {
        for angle in [0.1, 0.6] {
            let flat = surface(base.clone(), Displacement::None);
            let tolerance = ShellTolerance {
                angle,
                ..ShellTolerance::default()
            };
            let shell = Shell::new(&flat, &tolerance);
            let mut sides: BTreeMap<u32, Vec<BTreeMap<u16, [u32; 8]>>> = BTreeMap::new();
            for grid in shell.grids() {
                for k in (0..4).filter(|&k| !base.is_collapsed(grid.face, k)) {
                    let along = along(&shell, &base, grid, k);
                    let edge = base.edge(grid.face, k).edge;
                    // Every sample is a corner: between them there are sides of quads, or nothing.
                    let all: Vec<u16> = along.keys().copied().collect();
                    assert_eq!(all, (0..=grid.segments[k as usize]).collect::<Vec<_>>());
                    sides.entry(edge).or_default().push(along);
                }
            }
            for (edge, sides) in sides {
                let torn = shell.torn_edge(edge);
                for other in &sides[1..] {
                    for (a, b) in sides[0].values().zip(other.values()) {
                        assert_eq!(a[..3], b[..3], "{name}: positions at edge {edge}");
                        assert!(torn.normals || a[3..6] == b[3..6], "{name}: normals");
                        assert!(torn.texcoords || a[6..] == b[6..], "{name}: {edge}");
                    }
                }
            }
        }
    }
}

#[test]
fn only_creases_and_seams_are_torn() {
    let torn = |base: Arc<dyn Base>| {
        let flat = Surface::new(base, Displacement::None);
        let shell = Shell::new(&flat, &ShellTolerance::default());
        let count = flat.adjacency.edge_count();
        let of = |is: fn(Torn) -> bool| (0..count).filter(|&e| is(shell.torn_edge(e))).count();
        [of(|t| t.normals), of(|t| t.texcoords), count as usize]
    };
    let mut cube = cages::cube();
    // Without texture coordinates those are each face's parameters.
    let smooth = torn(Arc::new(Subdivision::new(&cube, None)));
    assert_eq!(smooth, [0, 12, 12]);
    cube.creases = [[0, 1], [1, 3]]
        .map(|vertices| Crease {
            vertices,
            sharpness: Crease::INFINITE,
        })
        .to_vec();
    let creased = torn(Arc::new(Subdivision::new(&cube, None)));
    assert_eq!(creased[0], 2, "{creased:?}");
}

#[test]
fn quads_are_as_near_as_asked_for() {
    for (name, base) in closed() {
        let flat = surface(base.moving(|p| 1.5 * p), Displacement::None);
        let mut last = 0;
        for distance in [1e-3, 1e-4] {
            let tolerance = ShellTolerance {
                distance,
                angle: 0.3,
            };
            let shell = Shell::new(&flat, &tolerance);
            let ShellError {
                distance,
                shift,
                angle,
                asked,
            } = shell.achieved();
            // A quad's middle is off by what both of its directions are.
            assert!(distance <= 2.5 * asked, "{name}: {distance} for {asked}");
            assert!(shift <= 40.0 * asked, "{name}: {shift} for {asked}");
            assert!(angle < 0.2, "{name}: {angle}");
            assert!(shell.quads() >= last, "{name}");
            last = shell.quads();
        }
        assert!(name.contains("cube") == (last == 6), "{name}: {last}");
    }
}

#[test]
fn holes_are_left_out() {
    let mut base = Patches::sphere(2);
    base.holes = vec![3];
    let shell = Shell::new(
        &surface(base, Displacement::None),
        &ShellTolerance::default(),
    );
    assert!(shell.grids().iter().all(|grid| grid.face != 3));
    let none = surface(Patches::empty(), Displacement::None);
    assert_eq!(Shell::new(&none, &ShellTolerance::default()).quads(), 0);
}
