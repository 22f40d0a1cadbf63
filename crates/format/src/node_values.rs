//! Values of attributes as filters test them: what the statistics of a file state about the values
//! of a node, and the exact values of a node's points, from its planes.

use crate::error::FormatError;
use crate::forest::Forest;
use crate::layout::{AttributePlane, PageLayout, PlaneKind};
use crate::reader::{EskerFile, Planes};
use crate::statistics::Statistics;
use esker_points::filter::{LatticeFilter, NodeValues, Side, ValueTests};
use esker_points::{AttrType, NodeTable};
use std::sync::Arc;

/// Least and greatest value of an attribute of a node's points, or of those of its subtree.
type StoredRange = for<'a> fn(&'a Statistics, u32, usize) -> Option<[&'a [u8]; 2]>;

/// Sides of the nodes of a file, by the classes and the values of their points.
#[derive(Debug)]
pub struct StatisticSides<'a> {
    filter: &'a LatticeFilter,
    /// None if the filter needs none.
    statistics: Option<Arc<Statistics>>,
    /// Table of the file, whose nodes are meant.
    table: &'a NodeTable,
    /// Whether all points have a class.
    have_classes: bool,
    tests: ValueTests,
    /// Of each attribute, whether all points have a value that is a number.
    are_all: Vec<bool>,
}

impl<'a> StatisticSides<'a> {
    /// Reads the statistics of `file`, if `filter` needs them.
    ///
    /// # Errors
    /// If they cannot be read or are damaged.
    pub fn new(file: &'a EskerFile, filter: &'a LatticeFilter) -> Result<Self, FormatError> {
        let statistics = filter.needs_statistics().then(|| file.shared_statistics()).transpose()?;
        let layout = file.layout();
        let schema = layout.schema();
        let have = |index: usize| {
            let attribute = &schema.attributes[index];
            let is_float = matches!(attribute.ty, AttrType::F32 | AttrType::F64);
            // Histograms count finite values alone.
            let counted = || {
                let counts = statistics.as_ref().map(|s| s.histograms().counts(index));
                counts.is_some_and(|all| all.iter().sum::<u64>() == file.footer().points)
            };
            layout.all_have_one_of(&[attribute.key()]) && (!is_float || counted())
        };
        let tests = filter.value_tests(schema);
        let mut are_all = vec![false; schema.attributes.len()];
        tests.attributes().into_iter().for_each(|index| are_all[index] = have(index));
        let class = (esker_points::attribute::names::CLASSIFICATION, AttrType::U8);
        let have_classes = layout.all_have_one_of(&[class]);
        Ok(Self { filter, statistics, table: file.table(), have_classes, tests, are_all })
    }

    /// Side of a node's own points.
    pub fn own(&self, node: u32) -> Side {
        self.side(node, Statistics::own_classes, Statistics::own_stored)
    }

    /// Side of the points of a node's subtree.
    pub fn subtree(&self, node: u32) -> Side {
        self.side(node, Statistics::subtree_classes, Statistics::subtree_stored)
    }

    fn side(
        &self,
        node: u32,
        classes: fn(&Statistics, u32) -> Option<[u64; 4]>,
        values: StoredRange,
    ) -> Side {
        let Some(statistics) = self.statistics.as_deref() else { return Side::Inside };
        let node = self.table.index_in_file(node);
        let by_classes = match self.filter.needs_classes() {
            true => self.filter.side_of_classes(classes(statistics, node), self.have_classes),
            false => Side::Inside,
        };
        let of = |attribute: usize| NodeValues {
            range: values(statistics, node, attribute),
            are_all: self.are_all[attribute],
        };
        by_classes.and(self.tests.side(of))
    }
}

/// Kinds of planes that have the values of attributes of a node of `file`, numbered as in `forest`.
pub(crate) fn kinds_of(forest: &Forest, file: &EskerFile, attributes: &[usize]) -> Vec<PlaneKind> {
    let layout = file.layout();
    let mut kinds = Vec::new();
    for &attribute in attributes {
        match layout.plane_of(attribute) {
            AttributePlane::Own => kinds.extend(own_kind(forest, layout, attribute)),
            AttributePlane::Intensity => kinds.push(PlaneKind::Intensity),
            AttributePlane::Colour => kinds.extend([PlaneKind::Colour, PlaneKind::ColourRemainder]),
        }
    }
    if !attributes.is_empty() {
        kinds.push(PlaneKind::Class);
    }
    kinds
}

/// Plane of an attribute that has its own.
fn own_kind(forest: &Forest, layout: &PageLayout, attribute: usize) -> Option<PlaneKind> {
    let of = &layout.schema().attributes[attribute];
    let index = forest.schema().find_typed(&of.name, of.ty)?;
    Some(PlaneKind::Attribute(u16::try_from(index).ok()?))
}

/// Exact values of some attributes of a node's points.
pub(crate) struct NodeColumns {
    /// Of each its index in the schema of the file, bytes of a value, and the values of all points.
    columns: Vec<(usize, usize, Vec<u8>)>,
}

impl NodeColumns {
    /// Takes the values from the planes of [`kinds_of`].
    pub(crate) fn of(
        forest: &Forest,
        file: &EskerFile,
        attributes: &[usize],
        planes: &Planes,
    ) -> Self {
        let layout = file.layout();
        let copy = |kind| planes.get(kind).unwrap_or_default().to_vec();
        let column = |&attribute: &usize| {
            let values = match layout.plane_of(attribute) {
                AttributePlane::Own => {
                    own_kind(forest, layout, attribute).map(copy).unwrap_or_default()
                }
                AttributePlane::Intensity => copy(PlaneKind::Intensity),
                AttributePlane::Colour => channel(layout, attribute, planes),
            };
            (attribute, layout.schema().attributes[attribute].ty.size(), values)
        };
        Self { columns: attributes.iter().map(column).collect() }
    }

    /// Bytes of a point's value of an attribute.
    pub(crate) fn value(&self, attribute: usize, point: usize) -> Option<&[u8]> {
        let (_, size, values) = self.columns.iter().find(|(index, ..)| *index == attribute)?;
        values.get(point * size..)?.get(..*size)
    }
}

/// Values of an attribute that is a part of the colour; zeros for points without it.
fn channel(layout: &PageLayout, attribute: usize, planes: &Planes) -> Vec<u8> {
    let colours = planes.get(PlaneKind::Colour).unwrap_or_default().as_chunks::<4>().0;
    let remainders = planes.get(PlaneKind::ColourRemainder).unwrap_or_default();
    let classes = planes.get(PlaneKind::Class).unwrap_or_default().as_chunks::<2>().0;
    let size = layout.schema().attributes[attribute].ty.size();
    let mut values = vec![0; colours.len() * size];
    for (i, (value, hot)) in values.chunks_exact_mut(size).zip(colours).enumerate() {
        let class = classes.get(i).map_or(0, |class| u16::from_le_bytes(*class));
        let Some(source) = layout.colour_of_class(class.into()) else { continue };
        let Some(k) = source.rgb.iter().position(|a| *a == attribute) else { continue };
        let cold = remainders.get(i * 3 + k).copied().unwrap_or_default();
        value.copy_from_slice(&source.value(hot[k], cold)[..size]);
    }
    values
}
