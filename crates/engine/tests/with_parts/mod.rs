//! Files whose node table can be read in parts although it is small.

use esker_format::{EskerFile, FileWriter, PartSizes};
use std::path::Path;

/// Copies a file, and gives its node table parts of these sizes.
pub fn with_parts(from: &Path, to: &Path, sizes: PartSizes) {
    let file = EskerFile::open(from).unwrap();
    let mut table = file.table().clone();
    let mut order: Vec<usize> = (0..table.nodes.len()).collect();
    order.sort_by_key(|&node| table.nodes[node].page_offset);
    let mut writer = FileWriter::create(to).unwrap();
    writer.set_part_sizes(sizes);
    for node in order {
        let page = file.read_page(node as u32).unwrap();
        table.nodes[node].page_offset = writer.write_page(page.bytes()).unwrap();
    }
    let mut metadata = file.metadata().clone();
    for (index, source) in metadata.sources.iter_mut().enumerate() {
        source.verbatim = file.verbatim(index).unwrap();
    }
    let (statistics, footer) = (file.statistics().unwrap(), file.footer());
    writer.finish(&table, &statistics, &metadata, footer.points, footer.hash).unwrap();
}
