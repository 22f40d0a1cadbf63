//! Links and validates shaders, and generates `shaders.rs` from them: the linked texts, the layouts
//! of structures and the values of constants, which Rust compares with its own (`same_layout!`,
//! `same_values!`). A shader that naga refuses fails the build. Each file `shaders/PASS/NAME.wgsl`
//! becomes `sources::PASS_NAME`; files of `shaders/common` are only included. Part of the build
//! scripts of all crates that have shaders.

#[path = "../src/gpu/device/link.rs"]
#[allow(dead_code, reason = "the crate uses more of it")]
mod link;

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{Expression, Handle, Literal, Module};
use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Size of each structure, and the offsets of its members, bytes.
type Layouts = BTreeMap<String, (u32, Vec<(String, u32)>)>;

/// Constants by the file that declares them, then by name.
type Constants = BTreeMap<String, BTreeMap<String, Value>>;

/// A constant in Rust.
#[derive(Clone, PartialEq)]
struct Value {
    ty: String,
    literal: String,
}

/// Writes `shaders.rs` for the folders of `shaders/` that `is_linked` accepts.
///
/// # Errors
/// If a file cannot be read or written, or a shader is not valid.
pub fn generate(is_linked: impl Fn(&str) -> bool) -> Result<(), Box<dyn Error>> {
    let root = Path::new(&std::env::var("CARGO_MANIFEST_DIR")?).join("../../shaders");
    let root = root.canonicalize().map_err(|e| format!("{}: {e}", root.display()))?;
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    let mut layouts = Layouts::new();
    let mut constants = Constants::new();
    let mut generated = String::new();
    for file in shaders(&root, is_linked)? {
        let (text, included) = link::link(&root, &file)?;
        watch(&root, &included)?;
        let module = validated(&text, &file)?;
        collect_layouts(&module, &file, &mut layouts)?;
        collect_constants(&module, &root, &included, &mut constants)?;
        let name = file.trim_end_matches(".wgsl").replace(['/', '-'], "_");
        let linked = out.join(format!("{name}.wgsl"));
        std::fs::write(&linked, text)?;
        writeln!(
            generated,
            "/// `shaders/{file}`, linked.\npub const {}: Source = Source {{ file: {file:?}, wgsl: include_str!({linked:?}) }};",
            name.to_uppercase()
        )?;
    }
    write_layouts(&layouts, &mut generated)?;
    write_constants(&constants, &mut generated)?;
    std::fs::write(out.join("shaders.rs"), generated)?;
    Ok(())
}

/// Has the build script run again when one of `files` changes, or when a file is added to one of
/// their folders. Other folders hold the shaders of other crates.
fn watch(root: &Path, files: &[PathBuf]) -> Result<(), Box<dyn Error>> {
    let folders: BTreeSet<&Path> = files.iter().filter_map(|file| file.parent()).collect();
    for path in files.iter().map(PathBuf::as_path).chain(folders) {
        // Named from here, so that a kept target folder notices another clone's shaders.
        println!("cargo::rerun-if-changed=../../shaders/{}", path.strip_prefix(root)?.display());
    }
    Ok(())
}

/// Parses and validates a linked shader.
fn validated(text: &str, file: &str) -> Result<Module, Box<dyn Error>> {
    let module =
        naga::front::wgsl::parse_str(text).map_err(|e| e.emit_to_string_with_path(text, file))?;
    let allowed = Capabilities::default()
        | Capabilities::SHADER_INT64
        | Capabilities::SHADER_INT64_ATOMIC_MIN_MAX;
    Validator::new(ValidationFlags::all(), allowed)
        .validate(&module)
        .map_err(|e| e.emit_to_string_with_path(text, file))?;
    Ok(module)
}

/// Writes a module `layout` with a module for each structure: its `SIZE` and the offsets of its
/// members.
fn write_layouts(layouts: &Layouts, generated: &mut String) -> Result<(), std::fmt::Error> {
    writeln!(
        generated,
        "/// Sizes and offsets of the shaders' structures, bytes.\n#[allow(dead_code, reason = \"Rust compares the structures that it has\")]\npub mod layout {{"
    )?;
    for (name, (size, members)) in layouts {
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
    writeln!(generated, "}}")
}

/// Writes a module `constants` with a module for each file that declares constants. A constant that
/// Rust neither compares, uses nor names in `without_twin!` is dead code, and fails the build.
fn write_constants(constants: &Constants, generated: &mut String) -> Result<(), std::fmt::Error> {
    let reason = "a constant of a shader is compared by same_values!, or named in without_twin!";
    writeln!(
        generated,
        "/// Constants of the shaders, by the files that declare them.\n#[deny(dead_code, reason = {reason:?})]\n#[allow(clippy::approx_constant, reason = \"WGSL has no named constants\")]\npub(crate) mod constants {{"
    )?;
    for (file, values) in constants {
        let module = file.trim_end_matches(".wgsl").replace(['/', '-'], "_");
        writeln!(generated, "/// `shaders/{file}`.\npub(crate) mod {module} {{")?;
        for (name, Value { ty, literal }) in values {
            writeln!(generated, "pub(crate) const {name}: {ty} = {literal};")?;
        }
        writeln!(generated, "}}")?;
    }
    writeln!(generated, "}}")
}

/// Files of the shaders to link, relative to `root`, sorted.
fn shaders(root: &Path, is_linked: impl Fn(&str) -> bool) -> Result<Vec<String>, Box<dyn Error>> {
    let mut found = Vec::new();
    for folder in std::fs::read_dir(root)? {
        let folder = folder?;
        let is_left_out =
            folder.file_name() == "common" || !is_linked(&folder.file_name().to_string_lossy());
        if !folder.file_type()?.is_dir() || is_left_out {
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

/// Adds the layouts of a module's structures.
///
/// # Errors
/// If structures of the same name have different layouts.
fn collect_layouts(
    module: &Module,
    file: &str,
    layouts: &mut Layouts,
) -> Result<(), Box<dyn Error>> {
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

/// Adds the constants of a module to those of the files that declare them; `included` are the files
/// that the module was linked from.
///
/// # Errors
/// If a constant is neither a scalar nor an array or vector of scalars.
fn collect_constants(
    module: &Module,
    root: &Path,
    included: &[PathBuf],
    constants: &mut Constants,
) -> Result<(), Box<dyn Error>> {
    let mut texts = Vec::new();
    for path in included {
        let file = path.strip_prefix(root)?.to_string_lossy().replace('\\', "/");
        texts.push((file, std::fs::read_to_string(path)?));
    }
    for (_, constant) in module.constants.iter() {
        let Some(name) = &constant.name else { continue };
        let head = format!("const {name}:");
        let declares = |text: &str| text.lines().any(|line| line.starts_with(&head));
        let Some((file, _)) = texts.iter().find(|(_, text)| declares(text)) else {
            return Err(format!("`const {name}: TYPE` begins no line of {texts:?}").into());
        };
        let value = value_of(module, constant.init)
            .ok_or_else(|| format!("{file}: {name} has a type that build.rs cannot write"))?;
        constants.entry(file.clone()).or_default().insert(name.clone(), value);
    }
    Ok(())
}

/// The value of an expression that naga has evaluated; `None` if it has no simple type.
fn value_of(module: &Module, expression: Handle<Expression>) -> Option<Value> {
    let scalar = |ty: &str, literal: String| Some(Value { ty: ty.into(), literal });
    match &module.global_expressions[expression] {
        Expression::Literal(Literal::F32(v)) => scalar("f32", format!("{v:?}")),
        Expression::Literal(Literal::U32(v)) => scalar("u32", v.to_string()),
        Expression::Literal(Literal::I32(v)) => scalar("i32", v.to_string()),
        Expression::Literal(Literal::Bool(v)) => scalar("bool", v.to_string()),
        Expression::Constant(constant) => value_of(module, module.constants[*constant].init),
        Expression::Splat { size, value } => {
            array_of(vec![value_of(module, *value)?; *size as usize])
        }
        Expression::Compose { components, .. } => {
            array_of(components.iter().map(|&c| value_of(module, c)).collect::<Option<_>>()?)
        }
        _ => None,
    }
}

fn array_of(values: Vec<Value>) -> Option<Value> {
    let ty = format!("[{}; {}]", values.first()?.ty, values.len());
    let literals: Vec<_> = values.into_iter().map(|v| v.literal).collect();
    Some(Value { ty, literal: format!("[{}]", literals.join(", ")) })
}
