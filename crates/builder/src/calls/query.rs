//! Points of an `.esker` file, and of the files that it names, that pass a filter, as columns: read
//! in groups of nodes, in the order of their pages, the oldest tree first. Nodes that the node
//! table and the statistics exclude are not read, of the others only the planes of the columns that
//! are wanted. A group is bounded, whatever the size of the file.

use crate::calls::export_tree::{
    SelectedNode, filter_points, groups, make_exact, own_attributes, select_nodes,
};
use crate::error::BuildError;
use esker_format::{EskerFile, Forest, Wanted, runs};
use esker_points::attribute::names;
use esker_points::filter::LatticeFilter;
use esker_points::{AttrType, Filter, Schema, Task};
use rayon::prelude::*;
use std::sync::Arc;

/// Nodes of files at addresses that are fetched together.
const READ_AHEAD: usize = 32;

/// Points as columns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QueryPoints {
    /// Coordinates on [`Forest::exact_lattice`].
    pub positions: Vec<[u32; 3]>,
    /// Raw little-endian values of the wanted attributes, in their order; zeros where the scan of a
    /// point lacks one.
    pub columns: Vec<Vec<u8>>,
}

/// A tree: its index in the forest, what is read of it, and for each wanted attribute of the forest
/// its own.
struct QueryTree {
    tree: usize,
    wanted: Wanted,
    own: Vec<Option<usize>>,
}

/// A query in progress.
pub struct Query {
    forest: Arc<Forest>,
    filter: LatticeFilter,
    sizes: Vec<usize>,
    trees: Vec<QueryTree>,
    /// Nodes of all trees, each with the index of its tree in `trees`.
    nodes: Vec<(usize, SelectedNode)>,
    next: usize,
    ahead: usize,
}

impl Query {
    /// Selects the nodes of `forest` with points that may pass `filter`, and the `wanted`
    /// attributes, indices of the forest's schema.
    ///
    /// # Errors
    /// If the filter is wrong, or the statistics of a file cannot be read.
    pub fn new(forest: Arc<Forest>, filter: &Filter, wanted: &[usize]) -> Result<Self, BuildError> {
        let wrong = |e: esker_points::FilterError| {
            BuildError::Options(format!("{}: {e}", forest.path().display()))
        };
        let filter = filter.on(&forest.exact_lattice(), forest.schema()).map_err(wrong)?;
        let attributes = &forest.schema().attributes;
        let wanted: Vec<_> = wanted.iter().filter_map(|&i| attributes.get(i)).cloned().collect();
        let sizes = wanted.iter().map(|a| a.ty.size()).collect();
        let schema = Schema { attributes: wanted };
        let wanted_bytes = schema.record_bytes();
        let (mut trees, mut nodes) = (Vec::new(), Vec::new());
        // A file names older files, so the last one listed is the oldest.
        for (tree, file) in forest.files().enumerate().collect::<Vec<_>>().into_iter().rev() {
            let own = own_attributes(file, &schema);
            let read = own.iter().copied().flatten().chain(tested(file, &filter));
            let wanted = Wanted::of(file.layout(), read);
            // Attributes that a tree lacks take as much memory as others.
            let point_bytes = wanted_bytes + wanted.record_bytes(file.layout());
            let selected = select_nodes(file, &filter, point_bytes)?;
            nodes.extend(selected.into_iter().map(|node| (trees.len(), node)));
            trees.push(QueryTree { tree, wanted, own });
        }
        Ok(Self { forest, filter, sizes, trees, nodes, next: 0, ahead: 0 })
    }

    /// The files.
    pub fn forest(&self) -> &Forest {
        &self.forest
    }

    /// Number of points that are left: exact if no point has to be tested, otherwise the most there
    /// can be.
    pub fn points_max(&self) -> u64 {
        self.nodes[self.next..].iter().map(|(_, node)| node.run.len() as u64).sum()
    }

    /// Whether some points have to be tested.
    pub fn is_partial(&self) -> bool {
        self.nodes[self.next..].iter().any(|(_, node)| node.is_partial)
    }

    /// Reads the next group of nodes in the current rayon pool; `None` at the end. A group may have
    /// no point.
    ///
    /// # Errors
    /// That of the first node with one: if its planes cannot be read or are damaged; on request.
    pub fn read(&mut self, task: &dyn Task) -> Result<Option<Vec<QueryPoints>>, BuildError> {
        task.check()?;
        let rest = &self.nodes[self.next..];
        let bytes =
            |(_, node): &(usize, SelectedNode)| node.decoded_bytes.max(u64::from(node.page_bytes));
        let Some(group) = groups(rest, bytes).next() else { return Ok(None) };
        let end = self.next + group.len();
        self.read_ahead(end);
        let read = |(tree, node): &(usize, SelectedNode)| {
            let read = self.read_node(&self.trees[*tree], node, task)?;
            task.advance(node.run.len() as u64);
            Ok(read)
        };
        // All results are collected first, so that the first error in file order is reported.
        let points: Vec<Result<_, BuildError>> =
            self.nodes[self.next..end].par_iter().map(read).collect();
        self.next = end;
        points.into_iter().collect::<Result<_, _>>().map(Some)
    }

    /// Says which nodes are read next, for files at addresses.
    fn read_ahead(&mut self, end: usize) {
        if end <= self.ahead {
            return;
        }
        self.ahead = (end + READ_AHEAD).min(self.nodes.len());
        let ahead = &self.nodes[self.next..self.ahead];
        for of_tree in ahead.chunk_by(|a, b| a.0 == b.0) {
            let tree = &self.trees[of_tree[0].0];
            if let Some(file) = self.forest.files().nth(tree.tree) {
                file.will_read_parts(of_tree.iter().map(|(_, node)| node.node), &tree.wanted);
            }
        }
    }

    fn read_node(
        &self,
        tree: &QueryTree,
        node: &SelectedNode,
        task: &dyn Task,
    ) -> Result<QueryPoints, BuildError> {
        task.check()?;
        let Some(file) = self.forest.files().nth(tree.tree) else {
            return Ok(QueryPoints::default());
        };
        let mut points = file.read_part(node.node, node.run.clone(), &tree.wanted)?;
        make_exact(file, node.node, node.run.clone(), &mut points)?;
        filter_points(file, &self.filter, node, &mut points)?;
        let count = points.len();
        let of = |(own, size): (&Option<usize>, &usize)| match own {
            Some(own) => std::mem::take(&mut points.columns[*own]),
            None => vec![0; count * size],
        };
        let columns = tree.own.iter().zip(&self.sizes).map(of).collect();
        Ok(QueryPoints { positions: points.positions, columns })
    }
}

/// Attributes of a file that a filter tests.
fn tested(file: &EskerFile, filter: &LatticeFilter) -> Vec<usize> {
    let schema = file.layout().schema();
    let named = |name: &str| schema.find_typed(name, AttrType::U8);
    let mut tested = Vec::new();
    if filter.needs_classes() {
        tested.extend([named(names::CLASSIFICATION), named(names::FLAGS)].into_iter().flatten());
    }
    tested.extend(filter.value_tests(schema).attributes());
    tested
}

/// Reads single points, each given by its node in the table of `forest` and its index in the node;
/// in the order given, with the `wanted` attributes, indices of the forest's schema. Uses the
/// current rayon pool.
///
/// # Errors
/// If there is no such point, a file cannot be read or is damaged, or on request.
pub fn points_at(
    forest: &Forest,
    places: &[[u32; 2]],
    wanted: &[usize],
    task: &dyn Task,
) -> Result<QueryPoints, BuildError> {
    let attributes = &forest.schema().attributes;
    let wanted: Vec<_> = wanted.iter().filter_map(|&i| attributes.get(i)).cloned().collect();
    let sizes: Vec<usize> = wanted.iter().map(|a| a.ty.size()).collect();
    let schema = Schema { attributes: wanted };
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by_key(|&i| places[i]);
    let of_nodes: Vec<&[usize]> = order.chunk_by(|&a, &b| places[a][0] == places[b][0]).collect();
    let read = |of_node: &&[usize]| {
        task.check()?;
        read_places(forest, places, of_node, &schema)
    };
    // All results are collected first, so that the first error in file order is reported.
    let found: Vec<Result<_, BuildError>> = of_nodes.par_iter().map(read).collect();
    let mut all = QueryPoints {
        positions: vec![[0; 3]; places.len()],
        columns: sizes.iter().map(|size| vec![0; size * places.len()]).collect(),
    };
    for (of_node, points) in of_nodes.into_iter().zip(found) {
        let points = points?;
        for (i, &place) in of_node.iter().enumerate() {
            all.positions[place] = points.positions[i];
            let columns = all.columns.iter_mut().zip(&points.columns).zip(&sizes);
            for ((to, from), &size) in columns {
                to[place * size..][..size].copy_from_slice(&from[i * size..][..size]);
            }
        }
    }
    Ok(all)
}

/// Reads the points at the indices `of_node` of `places`, which are in one node and ascending.
fn read_places(
    forest: &Forest,
    places: &[[u32; 2]],
    of_node: &[usize],
    schema: &Schema,
) -> Result<QueryPoints, BuildError> {
    let no_point = |[node, point]: [u32; 2]| {
        let path = forest.path().display();
        BuildError::Options(format!("{path}: node {node} has no point {point}"))
    };
    let Some(&first) = of_node.first() else { return Ok(QueryPoints::default()) };
    let node = places[first][0];
    let record = forest.table().nodes.get(node as usize).ok_or_else(|| no_point(places[first]))?;
    let beyond = of_node.iter().find(|&&i| places[i][1] as usize >= record.points());
    if let Some(&beyond) = beyond {
        return Err(no_point(places[beyond]));
    }
    let (file, index) = (forest.file_of(node), forest.name_of(node).index);
    let own = own_attributes(file, schema);
    let wanted = Wanted::of(file.layout(), own.iter().copied().flatten());
    let mut found = QueryPoints {
        positions: Vec::with_capacity(of_node.len()),
        columns: vec![Vec::new(); own.len()],
    };
    let mut rest = of_node;
    let point_bytes = schema.record_bytes() + wanted.record_bytes(file.layout());
    for run in runs(record.points(), point_bytes) {
        let here = rest.partition_point(|&i| (places[i][1] as usize) < run.end);
        let (of_run, behind) = rest.split_at(here);
        rest = behind;
        if of_run.is_empty() {
            continue;
        }
        let mut points = file.read_part(index, run.clone(), &wanted)?;
        make_exact(file, index, run.clone(), &mut points)?;
        for &i in of_run {
            let at = places[i][1] as usize - run.start;
            found.positions.push(points.positions[at]);
            for ((to, own), attribute) in found.columns.iter_mut().zip(&own).zip(&schema.attributes)
            {
                let size = attribute.ty.size();
                match own {
                    Some(own) => to.extend_from_slice(&points.columns[*own][at * size..][..size]),
                    None => to.resize(to.len() + size, 0),
                }
            }
        }
    }
    Ok(found)
}
