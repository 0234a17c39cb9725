//! One walk over the composed prims, with what they inherit carried down.

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

use openusd::sdf;
use openusd::tf::Token;
use openusd::usd::{Prim, Stage, TimeCode};
use openusd_schemas::geom::XformQuery;

use super::collect::Collected;
use super::gprim;
use super::material::Bound;
use super::motion::Motion;
use super::value;
use crate::error::{Fault, Result, Warnings};
use crate::math::{DAffine3, DMat4, Vec3};
use crate::mesh::{ControlMesh, Primvar};
use crate::scene::{
    Description, LoadOptions, Material, Placement, PtexSource, Purpose, Shape, TextureSource,
};

/// Prims that are visited at most; a file can compose to any number of them.
const MAX_PRIMS: usize = 4 << 20;
/// How deep prims may nest.
const MAX_DEPTH: usize = 1000;

/// What reads a stage.
pub(super) struct Reader {
    pub(super) stage: Stage,
    pub(super) file: PathBuf,
    pub(super) warnings: Warnings,
    /// What could not be read while something else was borrowed.
    pub(super) unreadable: RefCell<Warnings>,
    /// The frame.
    pub(super) time: f64,
    /// What is shown beside the default purpose.
    purposes: Vec<Purpose>,
    /// Shutter open and close, in frames; `None` where nothing is to move.
    pub(super) shutter: Option<[f64; 2]>,
    pub(super) frames_per_second: f64,
    pub(super) options: LoadOptions,
    prims: usize,
    pub(super) placed: usize,
    pub(super) here: Collected,
    /// Length of the path of what is being collected.
    pub(super) prefix: usize,
    pub(super) shapes: Vec<Shape>,
    /// Shapes by the prim that defines them.
    pub(super) shape_of: HashMap<String, Vec<super::mesh::Known>>,
    /// Tiles by the prim that defines them.
    pub(super) tile_of: HashMap<String, Arc<ControlMesh>>,
    pub(super) materials: Vec<Material>,
    pub(super) material_of: HashMap<String, Option<usize>>,
    pub(super) textures: Vec<TextureSource>,
    pub(super) ptex: Vec<PtexSource>,
    pub(super) prototypes: HashMap<String, Vec<(Inherited, Rc<Collected>)>>,
    /// Prototypes that are being collected, against those that hold themselves.
    pub(super) open: Vec<String>,
}

/// What a prim has from above, its own opinions included.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Inherited {
    pub(super) visible: bool,
    pub(super) purpose: Option<String>,
    pub(super) full: Option<Bound>,
    pub(super) all: Option<Bound>,
    /// Whether a collection may bind what is below.
    pub(super) collections: bool,
    pub(super) display_color: Option<Vec3>,
    pub(super) primvars: Rc<Vec<Primvar>>,
}

/// Where the walk is.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) world: Motion,
    pub(super) reset: bool,
    pub(super) inherited: Inherited,
    pub(super) in_instance: bool,
    pub(super) depth: usize,
}

impl Default for State {
    fn default() -> Self {
        Self {
            world: DAffine3::IDENTITY.into(),
            reset: false,
            inherited: Inherited {
                visible: true,
                purpose: None,
                full: None,
                all: None,
                collections: false,
                display_color: None,
                primvars: Rc::default(),
            },
            in_instance: false,
            depth: 0,
        }
    }
}

/// Whether `names` holds `name`.
pub(super) fn has(names: &[Token], name: &str) -> bool {
    names.iter().any(|n| n.as_str() == name)
}

impl Reader {
    pub(super) fn new(stage: Stage, file: &Path, options: &LoadOptions) -> Self {
        let frames_per_second = stage.time_codes_per_second();
        Self {
            stage,
            file: file.to_owned(),
            warnings: Warnings::default(),
            unreadable: RefCell::default(),
            time: 0.0,
            purposes: Vec::new(),
            shutter: None,
            frames_per_second: if frames_per_second > 0.0 {
                frames_per_second
            } else {
                24.0
            },
            options: options.clone(),
            prims: 0,
            placed: 0,
            here: Collected::default(),
            prefix: 0,
            shapes: Vec::new(),
            shape_of: HashMap::new(),
            tile_of: HashMap::new(),
            materials: Vec::new(),
            material_of: HashMap::new(),
            textures: Vec::new(),
            ptex: Vec::new(),
            prototypes: HashMap::new(),
            open: Vec::new(),
        }
    }

    /// Reads all of it but the list of files.
    pub(super) fn read(&mut self) -> Result<Description> {
        let start = self.stage.stage_metadata("startTimeCode").ok().flatten();
        let frame = self
            .options
            .frame
            .or_else(|| start.as_ref().and_then(value::number))
            .filter(|f| f.is_finite());
        self.time = frame.unwrap_or(0.0);
        let asked = self.options.settings.clone();
        let settings = self.settings(asked.as_deref())?;
        let wanted = self.options.purposes.clone();
        self.purposes = wanted
            .or_else(|| settings.included_purposes.clone())
            .unwrap_or_else(|| vec![Purpose::Render]);
        if self.options.motion_blur && settings.disable_motion_blur != Some(true) {
            self.shutter = self.find_shutter(settings.camera.as_deref());
        }
        let roots = self
            .stage
            .root_prims()
            .map_err(|e| Fault::new(e.to_string()).in_file(&self.file))?;
        let state = State::default();
        for name in roots {
            if let Ok(prim) = self.stage.prim(format!("/{name}")) {
                self.visit(&prim, &state, false)?;
            }
        }
        let collected = std::mem::take(&mut self.here);
        let mut placements = Vec::with_capacity(collected.items.len());
        for item in collected.items {
            if !item.motion.is_usable() {
                self.warn("unusable transform", || {
                    format!(
                        "{}: its transform is flat or not finite; it is left out",
                        item.path
                    )
                });
                continue;
            }
            placements.push(Placement {
                path: item.path,
                shape: item.shape,
                world_from_object: item.motion.keys().to_vec(),
                display_color: item.display_color,
                material: item.material,
            });
        }
        let mut cameras = Vec::new();
        for (mut camera, motion, _) in collected.cameras {
            if motion.is_usable() {
                camera.world_from_camera = motion.keys().to_vec();
                cameras.push(camera);
            } else {
                self.warn("unusable transform", || {
                    format!(
                        "{}: its transform is flat or not finite; it is left out",
                        camera.path
                    )
                });
            }
        }
        let mut lights = Vec::new();
        for (mut light, motion, _) in collected.lights {
            if motion.is_usable() {
                light.world_from_light = motion.at(0.5) * light.world_from_light;
                lights.push(light);
            } else {
                self.warn("unusable transform", || {
                    format!(
                        "{}: its transform is flat or not finite; it is left out",
                        light.path
                    )
                });
            }
        }
        self.warnings.extend(self.unreadable.take());
        let (up, meters_per_unit) = super::stage_metadata(&self.stage);
        Ok(Description {
            files: Vec::new(),
            up,
            meters_per_unit,
            frame,
            frames_per_second: self.frames_per_second,
            cameras,
            shapes: std::mem::take(&mut self.shapes),
            placements,
            lights,
            materials: std::mem::take(&mut self.materials),
            textures: std::mem::take(&mut self.textures),
            ptex: std::mem::take(&mut self.ptex),
            settings,
            warnings: Warnings::default(),
        })
    }

    /// The shutter of the camera that is asked for, of the settings' one, or of the first one.
    fn find_shutter(&self, settings: Option<&str>) -> Option<[f64; 2]> {
        let wanted = self.options.camera.as_deref().or(settings);
        let prim = match wanted {
            Some(path) if path.starts_with('/') => self.stage.prim(path).ok()?,
            name => self.find_camera(name)?,
        };
        let open = self.number(&prim, "shutter:open").unwrap_or(0.0);
        let close = self.number(&prim, "shutter:close").unwrap_or(0.0);
        (open.is_finite() && close.is_finite() && open < close)
            .then_some([self.time + open, self.time + close])
    }

    /// The first camera of that name, or of any.
    fn find_camera(&self, name: Option<&str>) -> Option<Prim> {
        let mut stack = vec![self.stage.prim("/").ok()?];
        let mut seen = 0;
        while let Some(prim) = stack.pop() {
            seen += 1;
            let depth = prim.path().prim_element_count();
            if seen > MAX_PRIMS || depth > MAX_DEPTH {
                return None;
            }
            if depth > 0 && !self.is_there(&prim) {
                continue;
            }
            if self.type_name(&prim) == "Camera"
                && name.is_none_or(|n| prim.path().name() == Some(n))
            {
                return Some(prim);
            }
            if !prim.is_instance().unwrap_or(false) {
                let children = prim.children().unwrap_or_default();
                stack.extend(children.into_iter().rev());
            }
        }
        None
    }

    /// Whether a prim is active and defined, and no class; above it that is known.
    fn is_there(&self, prim: &Prim) -> bool {
        matches!(prim.specifier(), Ok(Some(sdf::Specifier::Def)))
            && prim.is_active().unwrap_or(false)
    }

    /// Reads a prim and what is below it. `root` is the root of a prototype, which may be an `over`.
    pub(super) fn visit(&mut self, prim: &Prim, parent: &State, root: bool) -> Result<()> {
        self.prims += 1;
        let path = prim.path().as_str();
        if self.prims > MAX_PRIMS || parent.depth >= MAX_DEPTH {
            let what = if parent.depth >= MAX_DEPTH {
                format!("prims nest more than {MAX_DEPTH} deep")
            } else {
                format!("the file composes to more than {MAX_PRIMS} prims")
            };
            return Err(Fault::new(what)
                .in_file(&self.file)
                .at_prim(path)
                .advise("flatten the hierarchy or make parts instanceable")
                .into());
        }
        if !root && !self.is_there(prim) {
            return Ok(());
        }
        let type_name = self.type_name(prim);
        if matches!(
            type_name.as_str(),
            "Material" | "NodeGraph" | "Shader" | "GeomSubset"
        ) {
            return Ok(());
        }
        let names = self.authored(prim);
        let mut state = parent.clone();
        state.depth += 1;
        state.inherited = self.inherit(prim, &names, &parent.inherited);
        self.transform(prim, &names, &mut state);
        if self.is_shown(&state.inherited) {
            match type_name.as_str() {
                shape
                    if shape == "Mesh"
                        || shape == "NurbsPatch"
                        || gprim::TYPES.contains(&shape) =>
                {
                    self.place_shape(prim, &names, &state)?;
                }
                "PointInstancer" => return self.point_instancer(prim, &names, &state),
                "" | "Xform" | "Scope" | "Camera" | "SkelRoot" | "Skeleton" | "SkelAnimation"
                | "BlendShape" => {}
                other => self.other_prim(prim, other, &names, &state),
            }
        }
        if type_name == "PointInstancer" {
            return Ok(());
        }
        if type_name == "Camera"
            && let Some(mut camera) = self.camera(prim)
        {
            camera.path = self.relative(&camera.path);
            let motion = state.world.clone();
            self.here.cameras.push((camera, motion, state.reset));
        }
        if prim.is_instance().unwrap_or(false) {
            return self.instance(prim, &state);
        }
        let children = prim
            .children()
            .map_err(|e| Fault::new(e.to_string()).in_file(&self.file).at_prim(path))?;
        for child in children {
            self.visit(&child, &state, false)?;
        }
        Ok(())
    }

    /// Lights, and what relievo does not draw.
    fn other_prim(&mut self, prim: &Prim, type_name: &str, names: &[Token], state: &State) {
        if let Some(mut light) = self.light(prim, type_name, names) {
            light.path = self.relative(&light.path);
            let motion = state.world.clone();
            self.here.lights.push((light, motion, state.reset));
            return;
        }
        let silent = [
            "RectLight",
            "DiskLight",
            "SphereLight",
            "CylinderLight",
            "DistantLight",
            "DomeLight",
            "DomeLight_1",
            "Backdrop",
        ];
        let quiet = ["Render", "Physics", "Preliminary", "Spatial"];
        if silent.contains(&type_name) || quiet.iter().any(|q| type_name.starts_with(q)) {
            return;
        }
        self.warn(&format!("unsupported prim type {type_name}"), || {
            format!(
                "{}: unsupported prim type {type_name}",
                prim.path().as_str()
            )
        });
    }

    /// Whether it is visible and its purpose asked for.
    pub(super) fn is_shown(&self, inherited: &Inherited) -> bool {
        let purpose = inherited.purpose.as_deref().and_then(Purpose::from_word);
        inherited.visible && purpose.is_none_or(|p| self.purposes.contains(&p))
    }

    /// What a prim hands down.
    pub(super) fn inherit(&mut self, prim: &Prim, names: &[Token], above: &Inherited) -> Inherited {
        let mut out = above.clone();
        if has(names, "visibility") && self.word(prim, "visibility").as_deref() == Some("invisible")
        {
            out.visible = false;
        }
        if has(names, "purpose")
            && let Some(purpose) = self.word(prim, "purpose")
        {
            out.purpose = Some(purpose);
        }
        self.inherit_bindings(prim, names, &mut out);
        self.inherit_primvars(prim, names, &mut out);
        out
    }

    /// Applies the prim's own transform.
    pub(super) fn transform(&mut self, prim: &Prim, names: &[Token], state: &mut State) {
        let path = prim.path().as_str();
        if names.iter().any(|n| n.starts_with("motion:")) {
            self.warn("MotionAPI", || {
                format!("{path}: its motion settings are not honoured")
            });
        }
        if !names.iter().any(|n| n.starts_with("xformOp")) {
            return;
        }
        for name in names.iter().filter(|n| n.starts_with("xformOp:")) {
            if self.is_spline(prim, name) {
                self.warn("spline", || {
                    format!("{path}.{name}: animation by splines is not read; its default value is")
                });
            }
        }
        let query = match XformQuery::for_prim(prim) {
            Ok(query) => query,
            Err(e) => {
                return self.warn("unreadable transform", || format!("{path}: {e}"));
            }
        };
        let failed = RefCell::new(None);
        let at = |time: f64| match query.local_transformation(TimeCode::new(time)) {
            Ok(matrix) => DAffine3::from_mat4(DMat4::from_cols_array(&matrix.0)),
            Err(e) => {
                failed.replace(Some(e.to_string()));
                DAffine3::IDENTITY
            }
        };
        let moving = self
            .shutter
            .filter(|_| query.transform_might_be_time_varying().unwrap_or(false));
        let local = match moving {
            Some([open, close]) => Motion::sample(|t| at(open + (close - open) * t)),
            None => at(self.time).into(),
        };
        if let Some(error) = failed.take() {
            self.warn("unreadable transform", || format!("{path}: {error}"));
        }
        if query.resets_xform_stack() {
            state.world = local;
            state.reset = true;
        } else {
            state.world = state.world.then(&local);
        }
    }

    /// A path below what is being collected.
    pub(super) fn relative(&self, path: &str) -> String {
        path.get(self.prefix..).unwrap_or(path).to_owned()
    }

    /// Notes a warning.
    pub(super) fn warn(&mut self, kind: &str, message: impl FnOnce() -> String) {
        self.warnings.add(kind, message);
    }
}
