//! Rules of the node table. Every field of every record is checked before anything relies on it:
//! indices, links in both directions, nested cells, Morton order of siblings, counts, numbers, byte
//! ranges of pages.

use crate::error::Fault;
use crate::footer::HEADER_BYTES;
use crate::layout::{ALIGNMENT, PageLayout};
use esker_points::node::{LEVELS_MAX, NONE, Node, SHAPE_CONTINUATION};
use esker_points::quant::hot_shift;
use esker_points::{Cell, NodeTable};

/// Greatest number of points of a node, regardless of the capacity.
pub const NODE_POINTS_MAX: usize = 1 << 18;

/// Greatest size of a node's attributes when read, bytes. A value that all points share is stored
/// once: without this bound a small file could request all of a machine's memory.
pub const NODE_BYTES_MAX: u64 = 4 << 30;

/// Checks a table whose pages end before `pages_end`, and that it has `points` points in all.
pub(crate) fn check(
    table: &NodeTable,
    layout: &PageLayout,
    pages_end: u64,
    points: u64,
) -> Result<(), Fault> {
    let row_bytes = layout.schema().record_bytes() as u64;
    let mut total = 0;
    for (index, node) in table.nodes.iter().enumerate() {
        let fault = |what| Fault::new("node table", format!("node {index}: {what}"));
        check_record(node).map_err(fault)?;
        check_links(table, index).map_err(fault)?;
        check_width(node, row_bytes).map_err(fault)?;
        check_page(node, layout, pages_end).map_err(fault)?;
        total += node.points() as u64;
    }
    if total != points {
        let what = format!("its nodes have {total} points, the footer counts {points}");
        return Err(Fault::new("node table", what));
    }
    Ok(())
}

/// Checks a record of a table of `nodes` nodes, of which only a part is known: all but its parent
/// and the cells of its children.
pub(crate) fn check_node(
    node: &Node,
    index: u32,
    nodes: u32,
    layout: &PageLayout,
    pages_end: u64,
) -> Result<(), &'static str> {
    check_record(node)?;
    check_width(node, layout.schema().record_bytes() as u64)?;
    check_page(node, layout, pages_end)?;
    let children = node.children();
    match node.child_count {
        0 if node.first_child != 0 => Err("it has a child but no children"),
        0 => Ok(()),
        count
            if count > 8
                || node.first_child <= index
                || children.end > nodes
                || children.len() != usize::from(count) =>
        {
            Err("its children are not in the table behind it")
        }
        _ => Ok(()),
    }
}

/// Checks a record by itself.
fn check_record(node: &Node) -> Result<(), &'static str> {
    let cell = node.cell();
    if !cell.is_valid() {
        return Err("its cell is not a cube of the octree");
    }
    let levels = usize::from(node.level_count);
    if levels == 0
        || levels > LEVELS_MAX
        || node.level_counts[levels..] != [[0; 3]; LEVELS_MAX][levels..]
    {
        return Err("its number of levels is not possible");
    }
    let points = node.points();
    if points == 0 || points > NODE_POINTS_MAX {
        return Err("its number of points is not possible");
    }
    if node.shape >> 4 != 0 || node.reserved != [0; 3] {
        return Err("reserved bits are not zero");
    }
    if !cell.contains(node.box_min) || node.hot_shift > hot_shift(span(&cell)) {
        return Err("its integer box is not inside its cell");
    }
    let numbers = node.contour_centre.iter().chain(&node.contour_half).chain([&node.spacing]);
    if numbers.into_iter().any(|v| !v.is_finite())
        || node.contour_half.iter().any(|&h| h < 0.0)
        || node.spacing < 0.0
    {
        return Err("its contour or spacing is no usable number");
    }
    Ok(())
}

fn span(cell: &Cell) -> u32 {
    (cell.edge() - 1) as u32
}

fn check_links(table: &NodeTable, index: usize) -> Result<(), &'static str> {
    let node = &table.nodes[index];
    if index == 0 && (node.parent != NONE || node.is_continuation()) {
        return Err("the root has a parent");
    }
    if index > 0 {
        let parent =
            table.nodes.get(node.parent as usize).filter(|_| (node.parent as usize) < index);
        let Some(parent) = parent else { return Err("its parent does not come before it") };
        if !parent.children().contains(&(index as u32)) {
            return Err("its parent does not list it");
        }
    }
    let children = node.children();
    if node.child_count == 0 {
        return if node.first_child == 0 { Ok(()) } else { Err("it has a child but no children") };
    }
    if node.child_count > 8
        || (node.first_child as usize) <= index
        || children.end as usize > table.nodes.len()
        || children.len() != usize::from(node.child_count)
    {
        return Err("its children are not in the table behind it");
    }
    let children = &table.nodes[children.start as usize..children.end as usize];
    if children.iter().any(|c| c.parent as usize != index) {
        return Err("its children name another parent");
    }
    check_cells(node, children)
}

/// Checks that children are in different octants, in Morton order; a continuation is an only child
/// of equal cell.
pub(crate) fn check_cells(node: &Node, children: &[Node]) -> Result<(), &'static str> {
    let cell = node.cell();
    if let [only] = children
        && only.shape & SHAPE_CONTINUATION != 0
    {
        return if only.cell() == cell { Ok(()) } else { Err("its continuation has another cell") };
    }
    let mut last = None;
    for child in children {
        let inner = child.cell();
        if child.is_continuation() || !inner.is_valid() || inner.log2 >= cell.log2 {
            return Err("a child's cell is not smaller than its own");
        }
        if !cell.contains_cell(&inner) {
            return Err("a child's cell is not inside its own");
        }
        let octant = cell.octant(inner.corner);
        if last.is_some_and(|l| l >= octant) {
            return Err("its children are not in Morton order");
        }
        last = Some(octant);
    }
    Ok(())
}

fn check_width(node: &Node, row_bytes: u64) -> Result<(), &'static str> {
    if node.points() as u64 * row_bytes > NODE_BYTES_MAX {
        return Err("its attributes would take more than 4 GiB");
    }
    Ok(())
}

fn check_page(node: &Node, layout: &PageLayout, pages_end: u64) -> Result<(), &'static str> {
    let bytes = u64::from(node.page_bytes);
    if !node.page_offset.is_multiple_of(ALIGNMENT) || !bytes.is_multiple_of(ALIGNMENT) {
        return Err("its page is not aligned");
    }
    let end = node.page_offset.checked_add(bytes);
    if node.page_offset < HEADER_BYTES as u64 || end.is_none_or(|end| end > pages_end) {
        return Err("its page is not among the pages");
    }
    if bytes < layout.hot_bytes(node.points(), node.hot_shift) {
        return Err("its page is shorter than its planes");
    }
    Ok(())
}

/// Checks that pages are contiguous from the header to `pages_end`: every byte belongs to a page.
pub(crate) fn check_pages_fill(table: &NodeTable, pages_end: u64) -> Result<(), Fault> {
    let mut places: Vec<_> =
        table.nodes.iter().map(|n| (n.page_offset, u64::from(n.page_bytes))).collect();
    places.sort_unstable();
    let mut end = HEADER_BYTES as u64;
    for (offset, bytes) in places {
        if offset != end {
            return Err(Fault::new("node table", format!("pages overlap or leave a gap at {end}")));
        }
        end += bytes;
    }
    if end != pages_end {
        return Err(Fault::new("node table", format!("bytes from {end} on belong to no page")));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn a_node_whose_attributes_would_fill_memory_is_refused() {
        for (points, row_bytes, is_fine) in
            [(1 << 16, 1 << 16, true), (1 << 16, (1 << 16) + 1, false), (1 << 17, 60_000, false)]
        {
            let mut node = Node::zeroed();
            node.set_levels(&[points]);
            let checked = check_width(&node, row_bytes);
            assert_eq!(checked.is_ok(), is_fine, "{points} points of {row_bytes} bytes");
        }
    }
}
