//! Complete trees over grids of leaves, sixteen children a node: where their nodes are stored follows from their places.
//!
//! Level 0 are the leaves, in rows and columns as the grid has them; a node of level `l` has the 4 x 4 of level `l - 1`
//! below it, fewer at the grid's far sides. So a node's children follow from its own place: nothing points.

/// Children along a node's side.
pub(super) const FAN: usize = 4;

/// Levels of nodes: no grid has more than 4^6 leaves along a side.
pub(super) const MOST_LEVELS: usize = 6;

/// The shape of a face's tree. All faces of one size share it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shape {
    /// Where each level of nodes starts; the root is first.
    starts: [u32; MOST_LEVELS + 1],
    /// How many nodes there are.
    nodes: u32,
    /// Columns and rows at each level.
    sizes: [[u16; 2]; MOST_LEVELS + 1],
    /// Levels of nodes; none where a single leaf is all.
    levels: u16,
}

impl Shape {
    /// Over so many columns and rows of leaves. A single leaf has a node over it only if the tree is `rooted`.
    pub(super) fn new(leaves: [u16; 2], rooted: bool) -> Self {
        let mut sizes = [[1; 2]; MOST_LEVELS + 1];
        sizes[0] = leaves;
        let mut levels = 0;
        while sizes[levels] != [1; 2] || (rooted && levels == 0) {
            sizes[levels + 1] = sizes[levels].map(|n| n.div_ceil(FAN as u16));
            levels += 1;
        }
        let mut starts = [0; MOST_LEVELS + 1];
        let mut nodes = 0;
        for level in (1..=levels).rev() {
            starts[level] = nodes;
            nodes += u32::from(sizes[level][0]) * u32::from(sizes[level][1]);
        }
        Self {
            starts,
            nodes,
            sizes,
            levels: levels as u16,
        }
    }

    /// Levels of nodes; none where a single leaf is all.
    #[inline(always)]
    pub(super) fn levels(&self) -> usize {
        usize::from(self.levels)
    }

    /// How many nodes there are.
    #[inline(always)]
    pub(super) fn nodes(&self) -> usize {
        self.nodes as usize
    }

    /// Columns and rows at a level.
    #[inline(always)]
    pub(super) fn size(&self, level: usize) -> [usize; 2] {
        let [columns, rows] = self.sizes[level];
        [usize::from(columns), usize::from(rows)]
    }

    /// The number of the node in column `i` of row `j` of a level above 0.
    #[inline(always)]
    pub(super) fn node(&self, level: usize, i: usize, j: usize) -> usize {
        self.starts[level] as usize + j * usize::from(self.sizes[level][0]) + i
    }

    /// Columns and rows of children that a node has.
    #[inline(always)]
    pub(super) fn fan(&self, level: usize, i: usize, j: usize) -> [usize; 2] {
        let [columns, rows] = self.size(level - 1);
        [(columns - FAN * i).min(FAN), (rows - FAN * j).min(FAN)]
    }
}
