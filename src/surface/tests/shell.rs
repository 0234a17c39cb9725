//! Shells: as near as asked for, and of one piece.

use std::collections::BTreeMap;

use super::*;
use crate::mesh::Crease;

/// What a face has along edge `k` of its grid, in the edge's own direction.
fn along(shell: &Shell, base: &Patches, grid: &FaceGrid, k: u32) -> Vec<[u32; 8]> {
    let [nu, nv] = grid.size;
    let n = if k.is_multiple_of(2) { nu } else { nv };
    let mut along: Vec<[u32; 8]> = (0..=n)
        .map(|x| {
            let (i, j) = [(x, 0), (nu, x), (nu - x, nv), (0, nv - x)][k as usize];
            let vertex = grid.vertex(i, j) as usize;
            let ShellPoint { position, normal } = shell.points(0)[vertex];
            let st = shell.st()[vertex];
            let [x, y, z] = position.to_array();
            let [nx, ny, nz] = normal.to_array();
            [x, y, z, nx, ny, nz, st.x, st.y].map(f32::to_bits)
        })
        .collect();
    if base.edge(grid.face, k).reversed {
        along.reverse();
    }
    along
}

/// At most 64 micro-quads along each edge.
fn shell(flat: &Surface, tolerance: &ShellTolerance) -> Shell {
    Shell::new(flat, &Rates::uniform(flat, 64), tolerance, |needed, _| {
        needed
    })
}

#[test]
fn neighbours_have_the_same_corners() {
    for (name, base) in closed() {
        for (angle, most) in [(0.1, 64), (0.6, 64), (0.1, 3)] {
            let flat = surface(base.clone(), Displacement::None);
            let tolerance = ShellTolerance {
                angle,
                ..ShellTolerance::default()
            };
            let shell = Shell::new(&flat, &Rates::uniform(&flat, most), &tolerance, |n, _| n);
            let mut sides: BTreeMap<u32, Vec<Vec<[u32; 8]>>> = BTreeMap::new();
            for grid in shell.grids() {
                assert!(grid.size.iter().all(|&n| u32::from(n) <= most), "{name}");
                for k in (0..4).filter(|&k| !base.is_collapsed(grid.face, k)) {
                    let along = along(&shell, &base, grid, k);
                    let edge = base.edge(grid.face, k).edge;
                    sides.entry(edge).or_default().push(along);
                }
            }
            for (edge, sides) in sides {
                let torn = shell.torn_edge(edge);
                for other in &sides[1..] {
                    let ends = [(0, 0), (sides[0].len() - 1, other.len() - 1)];
                    for (a, b) in ends.map(|(a, b)| (sides[0][a], other[b])) {
                        assert_eq!(a[..3], b[..3], "{name}: ends of edge {edge}");
                    }
                    // Those that are cut alike.
                    if sides[0].len() != other.len() {
                        continue;
                    }
                    for (a, b) in sides[0].iter().zip(other) {
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
        let shell = shell(&flat, &ShellTolerance::default());
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
                heights: [-0.1, 0.2],
            };
            let shell = shell(&flat, &tolerance);
            let ShellError {
                distance,
                displaced,
                shift,
                angle,
                asked,
                ..
            } = shell.achieved();
            println!("{name}: {displaced} for {asked}, {} quads", shell.quads());
            assert!(distance <= displaced, "{name}: {distance} of {displaced}");
            assert!(displaced <= asked, "{name}: {displaced} for {asked}");
            assert!(shift <= 8.001 * asked, "{name}: {shift} for {asked}");
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
    let flat = surface(base, Displacement::None);
    let of_sphere = shell(&flat, &ShellTolerance::default());
    assert!(of_sphere.grids().iter().all(|grid| grid.face != 3));
    let none = surface(Patches::empty(), Displacement::None);
    assert_eq!(shell(&none, &ShellTolerance::default()).quads(), 0);
}
