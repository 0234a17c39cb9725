//! Values that a file gives its surface, carried to every point of it.

/// A primvar on a surface. Those that vary within faces follow the surface's own rules, which `V` knows.
pub(super) enum Carried<V> {
    /// One value for all of it.
    Constant(Vec<f32>),
    /// A value for each face of the file's.
    Uniform {
        width: usize,
        /// Face by face.
        values: Vec<f32>,
    },
    /// A value that varies within faces.
    Varying(V),
}

/// A value that varies within faces.
pub(super) trait Varying {
    /// Components.
    fn width(&self) -> usize;

    /// Bytes held.
    fn memory(&self) -> usize;
}

/// The primvars of a surface by slot, with their names.
pub(super) struct Slots<V>(Vec<(String, Carried<V>)>);

impl<V: Varying> Carried<V> {
    /// One value for each face.
    pub(super) fn uniform<'a>(width: usize, values: impl Iterator<Item = &'a [f32]>) -> Self {
        Self::Uniform {
            width,
            values: values.flatten().copied().collect(),
        }
    }

    /// Components.
    pub(super) fn width(&self) -> usize {
        match self {
            Self::Constant(value) => value.len(),
            Self::Uniform { width, .. } => *width,
            Self::Varying(varying) => varying.width(),
        }
    }

    fn memory(&self) -> usize {
        match self {
            Self::Constant(values) | Self::Uniform { values, .. } => size_of_val(values.as_slice()),
            Self::Varying(varying) => varying.memory(),
        }
    }
}

impl<V: Varying> Slots<V> {
    pub(super) fn new(primvars: Vec<(String, Carried<V>)>) -> Self {
        Self(primvars)
    }

    /// The slot of the primvar of this name, if it has at least `width` components.
    pub(super) fn slot(&self, name: &str, width: usize) -> Option<usize> {
        let fits = |(n, carried): &(String, Carried<V>)| n == name && carried.width() >= width;
        self.0.iter().position(fits)
    }

    /// The slot of the primvar of this name, if it can be texture coordinates: has two components and varies within
    /// faces.
    pub(super) fn texcoords(&self, name: Option<&str>) -> Option<usize> {
        let is_texcoord = |(n, carried): &(String, Carried<V>)| {
            Some(n.as_str()) == name
                && matches!(carried, Carried::Varying(varying) if varying.width() == 2)
        };
        self.0.iter().position(is_texcoord)
    }

    /// What varies within faces in a slot, if it does.
    pub(super) fn varying(&self, slot: usize) -> Option<&V> {
        match &self.0[slot].1 {
            Carried::Varying(varying) => Some(varying),
            _ => None,
        }
    }

    /// Fills `out` with the first components of a slot's value on a face of the file's, or leaves that to what varies
    /// within it.
    pub(super) fn get<'a>(&'a self, slot: usize, face: u32, out: &mut [f32]) -> Option<&'a V> {
        let value = match &self.0[slot].1 {
            Carried::Constant(value) => value,
            Carried::Uniform { width, values } => &values[face as usize * width..][..*width],
            Carried::Varying(varying) => return Some(varying),
        };
        out.copy_from_slice(&value[..out.len()]);
        None
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        self.0.iter().map(|(_, carried)| carried.memory()).sum()
    }
}
