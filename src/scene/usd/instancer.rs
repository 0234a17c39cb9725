//! UsdGeomPointInstancer.

use glam::{DMat3, DQuat, DVec3};
use openusd::sdf::{self, Value};
use openusd::tf::Token;
use openusd::usd::Prim;

use super::motion::Motion;
use super::value;
use super::walk::{Inherited, Reader, State, has};
use crate::error::{Fault, Result};
use crate::math::{DAffine3, Vec3};

/// The instances of an instancer at one moment.
struct Moment {
    positions: Vec<Vec3>,
    orientations: Vec<DQuat>,
    scales: Vec<Vec3>,
}

impl Moment {
    fn transform(&self, i: usize) -> DAffine3 {
        DAffine3 {
            matrix3: DMat3::from_quat(self.orientations.get(i).copied().unwrap_or(DQuat::IDENTITY))
                * DMat3::from_diagonal(self.scales.get(i).map_or(DVec3::ONE, |s| s.as_dvec3())),
            translation: self.positions[i].as_dvec3(),
        }
    }
}

impl Reader {
    /// Places the prototypes; they are not drawn where they stand.
    pub(super) fn point_instancer(
        &mut self,
        prim: &Prim,
        names: &[Token],
        state: &State,
    ) -> Result<()> {
        let path = prim.path().as_str().to_owned();
        let fault = |reader: &Self, message: String, help: &str| {
            Err(Fault::new(message)
                .in_file(&reader.file)
                .at_prim(path.clone())
                .advise(help)
                .into())
        };
        let which = self.integers(prim, "protoIndices");
        if which.is_empty() {
            self.warn("empty point instancer", || {
                format!("{path}: it has no instances")
            });
            return Ok(());
        }
        let targets = self.targets(prim, "prototypes");
        if let Some(&bad) = which
            .iter()
            .find(|&&i| usize::try_from(i).map_or(true, |i| i >= targets.len()))
        {
            return fault(
                self,
                format!("protoIndices name prototype {bad} of {}", targets.len()),
                "author as many prototypes as protoIndices need",
            );
        }
        let now = self.moment(prim, self.time);
        let count = which.len();
        for (what, length, optional) in [
            ("positions", now.positions.len(), false),
            ("orientations", now.orientations.len(), true),
            ("scales", now.scales.len(), true),
        ] {
            if length != count && !(optional && length == 0) {
                return fault(
                    self,
                    format!("{length} {what} for {count} protoIndices"),
                    "all arrays of a point instancer have one element for each instance",
                );
            }
        }
        let ids = self.integers(prim, "ids");
        if !ids.is_empty() && ids.len() != count {
            return fault(
                self,
                format!("{} ids for {count} protoIndices", ids.len()),
                "give one id for each instance, or none",
            );
        }
        let mut hidden: Vec<i64> = self.integers(prim, "invisibleIds");
        hidden.extend(inactive_ids(prim));
        hidden.sort_unstable();
        if has(names, "accelerations") {
            self.warn("accelerations", || {
                format!("{path}: accelerations are not honoured")
            });
        }
        let motions = self.instance_motions(prim, names, now);
        let colors = self.instance_colors(prim, names, count);

        let mut inner = state.clone();
        self.close_primvars(prim, &mut inner);
        inner.in_instance = true;
        let mut prototypes = Vec::with_capacity(targets.len());
        for (i, target) in targets.iter().enumerate() {
            if which.contains(&(i as i64)) {
                prototypes.push(Some(self.prototype(prim, target, &inner)?));
            } else {
                prototypes.push(None);
            }
        }
        for (i, (&prototype, motion)) in which.iter().zip(&motions).enumerate() {
            let id = ids.get(i).copied().unwrap_or(i as i64);
            if hidden.binary_search(&id).is_ok() {
                continue;
            }
            let Some(Some(collected)) = usize::try_from(prototype)
                .ok()
                .and_then(|p| prototypes.get(p))
            else {
                continue;
            };
            let collected = collected.clone();
            let mut placed = inner.clone();
            placed.world = state.world.then(motion);
            let color = colors.as_ref().and_then(|c| c.get(i).copied());
            self.expand(&collected, &format!("{path}/instance_{i}"), &placed, color)?;
        }
        Ok(())
    }

    /// What a prototype holds, its own transform included.
    fn prototype(
        &mut self,
        instancer: &Prim,
        target: &sdf::Path,
        state: &State,
    ) -> Result<std::rc::Rc<super::collect::Collected>> {
        let Some(prim) = self
            .stage
            .prim(target.clone())
            .ok()
            .filter(|p| p.is_valid().unwrap_or(false))
        else {
            self.warn("missing prototype", || {
                format!(
                    "{}: the prototype {target} is not there",
                    instancer.path().as_str()
                )
            });
            return Ok(std::rc::Rc::default());
        };
        // Between the instancer (or the root) and the prototype, all is inherited but transforms.
        let mut state = state.clone();
        let below = target.has_prefix(instancer.path());
        let outer = state.inherited.clone();
        if !below {
            state.inherited = Inherited {
                visible: true,
                purpose: outer.purpose.clone(),
                display_color: outer.display_color,
                ..State::default().inherited
            };
        }
        let mut between: Vec<sdf::Path> = target.strict_ancestors_below_root().collect();
        between.reverse();
        for path in between {
            if below && instancer.path().has_prefix(&path) {
                continue;
            }
            if let Ok(ancestor) = self.stage.prim(path) {
                let names = self.authored(&ancestor);
                state.inherited = self.inherit(&ancestor, &names, &state.inherited);
            }
        }
        self.close_primvars(&prim, &mut state);
        let key = format!("{target} of an instancer");
        self.collect(key, &prim, &state, |reader, inner| {
            reader.visit(&prim, inner, true)
        })
    }

    /// Where the instances are at a time.
    fn moment(&self, prim: &Prim, time: f64) -> Moment {
        let vectors = |name: &str| {
            self.value_at(prim, name, time)
                .and_then(value::vectors)
                .unwrap_or_default()
        };
        let rotations = |name: &str| {
            self.value_at(prim, name, time)
                .and_then(value::rotations)
                .filter(|r| !r.is_empty())
        };
        let orientations = rotations("orientationsf")
            .or_else(|| rotations("orientations"))
            .unwrap_or_default()
            .into_iter()
            .map(|q| {
                let q = DQuat::from_array(q);
                if q.length_squared() > 0.0 && q.is_finite() {
                    q.normalize()
                } else {
                    DQuat::IDENTITY
                }
            })
            .collect();
        Moment {
            positions: vectors("positions"),
            orientations,
            scales: vectors("scales"),
        }
    }

    /// The motion of each instance over the shutter.
    fn instance_motions(&mut self, prim: &Prim, names: &[Token], now: Moment) -> Vec<Motion> {
        let count = now.positions.len();
        let still = |now: &Moment| (0..count).map(|i| now.transform(i).into()).collect();
        let Some([open, close]) = self.shutter else {
            return still(&now);
        };
        let fps = self.frames_per_second;
        if let Some(velocities) = self.velocities(prim, "positions", count) {
            let spins = self
                .value(prim, "angularVelocities")
                .and_then(value::vectors)
                .filter(|v| v.len() == count)
                .unwrap_or_default();
            let frame = self.time;
            return (0..count)
                .map(|i| {
                    Motion::sample(|t| {
                        let seconds = (open + (close - open) * t - frame) / fps;
                        let mut transform = now.transform(i);
                        if let Some(spin) = spins.get(i).map(|s| s.as_dvec3())
                            && spin.length_squared() > 0.0
                        {
                            let angle = spin.length().to_radians() * seconds;
                            transform.matrix3 *= DMat3::from_axis_angle(spin.normalize(), angle);
                        }
                        transform.translation += velocities[i].as_dvec3() * seconds;
                        transform
                    })
                })
                .collect();
        }
        let moving = ["positions", "orientations", "orientationsf", "scales"]
            .into_iter()
            .filter(|n| has(names, n))
            .any(|n| {
                prim.attribute(n)
                    .value_might_be_time_varying()
                    .unwrap_or(false)
            });
        if !moving {
            return still(&now);
        }
        const KEYS: usize = 5;
        let moments: Vec<Moment> = (0..KEYS)
            .map(|k| self.moment(prim, open + (close - open) * k as f64 / (KEYS - 1) as f64))
            .collect();
        let fits = |m: &Moment| {
            m.positions.len() == count
                && m.orientations.len() == now.orientations.len()
                && m.scales.len() == now.scales.len()
        };
        if !moments.iter().all(fits) {
            self.warn("instances change in number", || {
                format!(
                    "{}: the number of instances changes within the shutter; they are not blurred",
                    prim.path().as_str()
                )
            });
            return still(&now);
        }
        (0..count)
            .map(|i| Motion::from_keys(moments.iter().map(|m| m.transform(i)).collect()))
            .collect()
    }

    /// The `displayColor` of each instance, if the instancer has one for each.
    fn instance_colors(&mut self, prim: &Prim, names: &[Token], count: usize) -> Option<Vec<Vec3>> {
        let name = "primvars:displayColor";
        if !has(names, name) {
            return None;
        }
        let primvar = self
            .primvar(
                prim,
                name,
                "displayColor",
                crate::mesh::Interpolation::Constant,
            )
            .ok()
            .flatten()
            .filter(|p| p.width == 3 && p.interpolation != crate::mesh::Interpolation::Constant)?;
        let given = primvar
            .indices
            .as_ref()
            .map_or(primvar.elements(), Vec::len);
        let elements = primvar.elements();
        let inside = primvar
            .indices
            .iter()
            .flatten()
            .all(|&i| (i as usize) < elements);
        (given == count && inside).then(|| {
            (0..count)
                .map(|i| Vec3::from_slice(primvar.get(i)))
                .collect()
        })
    }
}

/// Instances that are switched off by metadata.
fn inactive_ids(prim: &Prim) -> Vec<i64> {
    match prim.get_metadata::<Value>("inactiveIds") {
        Ok(Some(Value::Int64ListOp(op))) => op.flatten(),
        Ok(Some(Value::Int64Vec(ids))) => ids,
        _ => Vec::new(),
    }
}
