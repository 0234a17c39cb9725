//! What instances share: found once, placed often.

use std::rc::Rc;

use openusd::usd::Prim;

use super::motion::Motion;
use super::walk::{Reader, State};
use crate::error::{Error, Result};
use crate::math::{DAffine3, Vec3};
use crate::scene::{Camera, Light};

/// Placements that are made at most.
const MAX_PLACEMENTS: usize = 16 << 20;

/// What was found below some prim, placed relative to it.
#[derive(Default)]
pub(super) struct Collected {
    pub(super) items: Vec<Item>,
    pub(super) lights: Vec<(Light, Motion, bool)>,
    pub(super) cameras: Vec<(Camera, Motion, bool)>,
}

/// A placement before it is in the world.
pub(super) struct Item {
    pub(super) path: String,
    pub(super) motion: Motion,
    /// Whether `motion` leads to the world whatever is above.
    pub(super) reset: bool,
    pub(super) shape: usize,
    pub(super) display_color: Option<Vec3>,
    pub(super) material: Option<usize>,
}

impl Reader {
    /// Below a native instance: collected once for all instances of the prototype that inherit the same.
    pub(super) fn instance(&mut self, prim: &Prim, state: &State) -> Result<()> {
        let prototype = prim.prototype().ok().flatten();
        let key = prototype.map_or_else(
            || prim.path().as_str().to_owned(),
            |p| p.as_str().to_owned(),
        );
        let mut state = state.clone();
        self.close_primvars(prim, &mut state);
        state.in_instance = true;
        let collected = self.collect(key, prim, &state, |reader, inner| {
            let children = prim.children().unwrap_or_default();
            children
                .iter()
                .try_for_each(|child| reader.visit(child, inner, false))
        })?;
        self.expand(&collected, prim.path().as_str(), &state, None)
    }

    /// Primvars of the world outside do not reach into what is shared, but for `displayColor`.
    pub(super) fn close_primvars(&mut self, prim: &Prim, state: &mut State) {
        if let Some(first) = state.inherited.primvars.first() {
            let name = first.name.clone();
            self.warn("primvar inherited by an instance", || {
                format!(
                    "{}: primvar {name} is inherited from outside the instance and not honoured in it",
                    prim.path().as_str()
                )
            });
            state.inherited.primvars = Rc::default();
        }
    }

    /// What `walk` finds from the origin, remembered by `key` and what is inherited.
    pub(super) fn collect(
        &mut self,
        key: String,
        root: &Prim,
        state: &State,
        walk: impl FnOnce(&mut Self, &State) -> Result<()>,
    ) -> Result<Rc<Collected>> {
        let known = self.prototypes.get(&key).into_iter().flatten();
        if let Some((_, collected)) = known.into_iter().find(|(i, _)| *i == state.inherited) {
            return Ok(collected.clone());
        }
        if self.open.contains(&key) {
            self.warn("recursive instance", || {
                format!(
                    "{}: it instances itself; left out there",
                    root.path().as_str()
                )
            });
            return Ok(Rc::default());
        }
        let inner = State {
            world: DAffine3::IDENTITY.into(),
            reset: false,
            ..state.clone()
        };
        let outer = std::mem::take(&mut self.here);
        let prefix = std::mem::replace(&mut self.prefix, root.path().as_str().len());
        self.open.push(key.clone());
        let result = walk(self, &inner);
        self.open.pop();
        self.prefix = prefix;
        let collected = Rc::new(std::mem::replace(&mut self.here, outer));
        result?;
        self.prototypes
            .entry(key)
            .or_default()
            .push((state.inherited.clone(), collected.clone()));
        Ok(collected)
    }

    /// Places what was collected at `state`, below `path`.
    pub(super) fn expand(
        &mut self,
        collected: &Collected,
        path: &str,
        state: &State,
        color: Option<Vec3>,
    ) -> Result<()> {
        let path = self.relative(path);
        let place = |motion: &Motion, reset: bool| {
            if reset {
                motion.clone()
            } else {
                state.world.then(motion)
            }
        };
        self.count_placements(collected.items.len())?;
        for item in &collected.items {
            self.here.items.push(Item {
                path: format!("{path}{}", item.path),
                motion: place(&item.motion, item.reset),
                reset: item.reset || state.reset,
                shape: item.shape,
                display_color: color.or(item.display_color),
                material: item.material,
            });
        }
        for (light, motion, reset) in &collected.lights {
            let mut light = light.clone();
            light.path.insert_str(0, &path);
            let motion = place(motion, *reset);
            self.here
                .lights
                .push((light, motion, *reset || state.reset));
        }
        for (camera, motion, reset) in &collected.cameras {
            let mut camera = camera.clone();
            camera.path.insert_str(0, &path);
            let motion = place(motion, *reset);
            self.here
                .cameras
                .push((camera, motion, *reset || state.reset));
        }
        Ok(())
    }

    /// Adds one placement.
    pub(super) fn place(
        &mut self,
        prim: &Prim,
        state: &State,
        shape: usize,
        display_color: Option<Vec3>,
        material: Option<usize>,
    ) -> Result<()> {
        self.count_placements(1)?;
        let path = self.relative(prim.path().as_str());
        self.here.items.push(Item {
            path,
            motion: state.world.clone(),
            reset: state.reset,
            shape,
            display_color,
            material,
        });
        Ok(())
    }

    fn count_placements(&mut self, more: usize) -> Result<()> {
        self.placed += more;
        if self.placed > MAX_PLACEMENTS {
            return Err(Error::Memory {
                message: format!("the file has more than {MAX_PLACEMENTS} instances"),
                help: Some(
                    "merge small instances into one mesh, or render the scene in parts".into(),
                ),
            });
        }
        Ok(())
    }
}
