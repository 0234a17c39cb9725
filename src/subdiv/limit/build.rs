//! From a cage to its limit surface: the ring of each face, and a plan for each kind of ring.

use std::collections::HashMap;

use rayon::prelude::*;

use super::{Face, HOLE, LimitSurface};
use crate::subdiv::cage::Cage;
use crate::subdiv::patch::PatchKind;
use crate::subdiv::plan::Plan;
use crate::subdiv::ring::Ring;
use crate::subdiv::stencils::Stencils;
use crate::subdiv::step::{Shape, Steps};

impl LimitSurface {
    pub(super) fn of(cage: &Cage) -> Self {
        let topology = &cage.topology;
        let kind = match (cage.rules.triangles(), cage.rules.linear) {
            (false, false) => PatchKind::Bicubic,
            (false, true) => PatchKind::Bilinear,
            (true, false) => PatchKind::BoxSpline,
            (true, true) => PatchKind::Linear,
        };
        let mut surface = Self {
            kind,
            faces: Vec::new(),
            rings: Vec::new(),
            plans: Vec::new(),
            steps: Steps::default(),
            vertices: topology.vertex_count(),
            own_points: 0,
            first_ptex: vec![0],
        };
        // Rings and their keys come in parallel, a batch at a time so that they need not all be held.
        let faces: Vec<u32> = (0..topology.face_count() as u32).collect();
        let mut plans: HashMap<Vec<u32>, u32> = HashMap::new();
        for batch in faces.chunks(1 << 14) {
            let rings: Vec<Option<(Ring, Vec<u32>)>> = batch
                .par_iter()
                .with_min_len(64)
                .map(|&face| {
                    (!cage.hole[face as usize]).then(|| {
                        let ring = Ring::of(cage, face);
                        let key = ring.key();
                        (ring, key)
                    })
                })
                .collect();
            for (&face, ring) in batch.iter().zip(rings) {
                surface.add(cage, face, ring, &mut plans);
            }
        }
        surface
    }

    fn add(
        &mut self,
        cage: &Cage,
        face: u32,
        ring: Option<(Ring, Vec<u32>)>,
        plans: &mut HashMap<Vec<u32>, u32>,
    ) {
        let sides = cage.topology.corners(face).len();
        let parts = if self.is_triangular() || sides == 4 {
            1
        } else {
            sides
        };
        match ring {
            None => self.faces.extend(std::iter::repeat_n(
                Face {
                    plan: HOLE,
                    ring: 0,
                    own: 0,
                },
                parts,
            )),
            Some((ring, key)) => {
                let first = *plans.entry(key).or_insert_with(|| {
                    let first = self.plans.len() as u32;
                    self.plan(&ring, parts);
                    first
                });
                let start = self.rings.len() as u32;
                self.rings.extend(&ring.vertices);
                for part in 0..parts {
                    let plan = first + part as u32;
                    self.faces.push(Face {
                        plan,
                        ring: start,
                        own: self.own_points as u32,
                    });
                    self.own_points += self.plans[plan as usize].program.len();
                }
            }
        }
        self.first_ptex.push(self.faces.len() as u32);
    }

    /// Adds the plans of a face with this ring.
    fn plan(&mut self, ring: &Ring, parts: usize) {
        let size = ring.vertices.len() as u32;
        let own: Vec<u32> = (0..size).collect();
        let mut program = Stencils::with_capacity(0);
        let shape = self.steps.shape(ring, 0, &own, &mut |terms| {
            for (point, weight) in terms {
                program.add(point, weight);
            }
            program.end_row();
            size + program.len() as u32 - 1
        });
        match shape {
            Shape::Split { step, .. } if parts > 1 => {
                for part in 0..parts {
                    self.plans.push(Plan::of_child(&self.steps, step, part));
                }
            }
            shape => self
                .plans
                .push(Plan::new(&self.steps, size, program, &shape)),
        }
    }
}
