//! Links and validates the shaders, and writes down the offsets of their structures: a shader that naga
//! refuses does not build. Every `shaders/PASS/NAME.wgsl` becomes `sources::PASS_NAME`; what lies in
//! `shaders/common` is only included.

#[path = "src/gpu/device/link.rs"]
#[allow(dead_code, reason = "the crate uses more of it")]
mod link;

use naga::valid::{Capabilities, ValidationFlags, Validator};
use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write;
use std::path::{Path, PathBuf};

type Layouts = BTreeMap<String, (u32, Vec<(String, u32)>)>;

fn main() -> Result<(), Box<dyn Error>> {
    let root = Path::new(&std::env::var("CARGO_MANIFEST_DIR")?).join("../../shaders");
    let root = root.canonicalize().map_err(|e| format!("{}: {e}", root.display()))?;
    // Named from here, so that a kept target folder notices another clone's shaders.
    println!("cargo::rerun-if-changed=../../shaders");
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    let mut layouts = Layouts::new();
    let mut generated = String::new();
    for file in shaders(&root)? {
        let (text, _) = link::link(&root, &file)?;
        let module = naga::front::wgsl::parse_str(&text)
            .map_err(|e| e.emit_to_string_with_path(&text, &file))?;
        let allowed = Capabilities::default()
            | Capabilities::SHADER_INT64
            | Capabilities::SHADER_INT64_ATOMIC_MIN_MAX;
        Validator::new(ValidationFlags::all(), allowed)
            .validate(&module)
            .map_err(|e| e.emit_to_string_with_path(&text, &file))?;
        collect(&module, &file, &mut layouts)?;
        let name = file.trim_end_matches(".wgsl").replace(['/', '-'], "_");
        let linked = out.join(format!("{name}.wgsl"));
        std::fs::write(&linked, text)?;
        writeln!(
            generated,
            "/// `shaders/{file}`, linked.\npub const {}: Source = Source {{ file: {file:?}, wgsl: include_str!({linked:?}) }};",
            name.to_uppercase()
        )?;
    }
    writeln!(
        generated,
        "/// Sizes and offsets of the shaders' structures, bytes.\npub mod layout {{"
    )?;
    for (name, (size, members)) in &layouts {
        writeln!(
            generated,
            "/// `{name}`.\n#[allow(non_snake_case, reason = \"the shader's name\")]\npub mod {name} {{"
        )?;
        writeln!(generated, "/// Size.\npub const SIZE: usize = {size};")?;
        for (member, offset) in members {
            writeln!(
                generated,
                "/// Offset of `{member}`.\n#[allow(non_upper_case_globals, reason = \"the shader's name\")]\npub const {member}: usize = {offset};"
            )?;
        }
        writeln!(generated, "}}")?;
    }
    writeln!(generated, "}}")?;
    std::fs::write(out.join("shaders.rs"), generated)?;
    Ok(())
}

/// The shaders to link, relative to the root, in their order.
fn shaders(root: &Path) -> Result<Vec<String>, Box<dyn Error>> {
    let mut found = Vec::new();
    for folder in std::fs::read_dir(root)? {
        let folder = folder?;
        if !folder.file_type()?.is_dir() || folder.file_name() == "common" {
            continue;
        }
        for file in std::fs::read_dir(folder.path())? {
            let name = file?.file_name();
            if Path::new(&name).extension().is_some_and(|e| e == "wgsl") {
                found.push(format!(
                    "{}/{}",
                    folder.file_name().to_string_lossy(),
                    name.to_string_lossy()
                ));
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Adds the layouts of a module's structures; structures of one name must have one layout.
fn collect(module: &naga::Module, file: &str, layouts: &mut Layouts) -> Result<(), Box<dyn Error>> {
    for (_, ty) in module.types.iter() {
        let naga::TypeInner::Struct { members, span } = &ty.inner else { continue };
        let Some(name) = &ty.name else { continue };
        if members.iter().any(|m| m.binding.is_some()) {
            continue;
        }
        let members: Vec<_> =
            members.iter().filter_map(|m| Some((m.name.clone()?, m.offset))).collect();
        let layout = (*span, members);
        match layouts.get(name) {
            Some(known) if *known != layout => {
                return Err(format!("{file}: another structure is named {name} as well").into());
            }
            _ => layouts.insert(name.clone(), layout),
        };
    }
    Ok(())
}
