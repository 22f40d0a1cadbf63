//! What the machine can draw with (`esker info --system`): the adapters that its drivers show, what
//! each has of what the passes choose between, and which one is chosen and why. Works without any
//! driver.

use crate::io::quantity::readable_bytes;
use crate::machine::backend::{Backend, DrawWith, ProjectPath, wgpu};
use esker_render::gpu::{Tier, device};
use serde_json::{Value, json};
use wgpu::{Adapter, Backends, Features};

/// The adapters, and what `with` chooses.
pub fn system(with: &DrawWith) -> Value {
    let adapters: Vec<Value> = device::adapters(Backends::all()).iter().map(adapter).collect();
    let chosen = match with.choose(None) {
        Ok((Some(gpu), drawer)) => json!({
            "backend": drawer.backend(),
            "adapter": drawer.adapter,
            "path": drawer.path_name(),
            "why": why(&gpu.tier, with),
            "page_bytes_max": gpu.tier.page_bytes_max,
            "binding_bytes_max": gpu.tier.binding_bytes_max,
            "timestamps": gpu.tier.has_timestamps,
            "mappable_buffers": gpu.tier.is_mappable,
            "software": gpu.tier.is_software,
        }),
        Ok((None, drawer)) => {
            let why = drawer.note.unwrap_or_else(|| "it was asked for".into());
            json!({"backend": "cpu", "path": "cpu", "why": why})
        }
        // Only where a GPU is insisted on.
        Err(fault) => json!({"backend": null, "why": format!("{fault:#}")}),
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    json!({"adapters": adapters, "asked": with.backend.name(), "chosen": chosen, "threads": threads})
}

fn adapter(adapter: &Adapter) -> Value {
    let (info, features, limits) = (adapter.get_info(), adapter.features(), adapter.limits());
    let atomics = Features::SHADER_INT64 | Features::SHADER_INT64_ATOMIC_MIN_MAX;
    json!({
        "name": info.name,
        "interface": format!("{:?}", info.backend).to_lowercase(),
        "kind": format!("{:?}", info.device_type),
        "driver": format!("{} {}", info.driver, info.driver_info).trim(),
        "software": device::is_software(&info),
        "atomics_64": features.contains(atomics),
        "timestamps": features.contains(Features::TIMESTAMP_QUERY),
        "mappable_buffers": features.contains(Features::MAPPABLE_PRIMARY_BUFFERS),
        "buffer_bytes_max": limits.max_buffer_size,
        "binding_bytes_max": limits.max_storage_buffer_binding_size,
        "picture_side_max": limits.max_texture_dimension_2d,
    })
}

fn why(tier: &Tier, with: &DrawWith) -> String {
    let adapter = match (with.backend, tier.is_software) {
        (_, true) => "a software driver was asked for",
        (Backend::Gpu, false) => "a GPU was asked for, and this is the best one",
        _ => "it is the best GPU that there is",
    };
    let path = match (with.gpu.path, tier.path) {
        (Some(_), _) => "its path was asked for",
        (None, ProjectPath::Atomics) => "it has 64-bit atomics",
        (None, ProjectPath::Primitives) => "it has no 64-bit atomics, so points are primitives",
    };
    format!("{adapter}; {path}")
}

/// [`system`] for people.
pub fn text(system: &Value) -> String {
    let word = |value: &Value| value.as_str().unwrap_or("?").to_owned();
    let has = |value: &Value| if value == true { "yes" } else { "no" };
    let bytes = |value: &Value| readable_bytes(value.as_u64().unwrap_or(0));
    let mut lines = Vec::new();
    let adapters = system["adapters"].as_array().map_or(&[][..], Vec::as_slice);
    if adapters.is_empty() {
        lines.push("adapters     none: the system has no graphics driver".into());
    }
    for a in adapters {
        lines.push(format!(
            "adapter      {} by {}{}; {}",
            word(&a["name"]),
            word(&a["interface"]),
            if a["software"] == true { ", a software driver" } else { "" },
            word(&a["driver"]),
        ));
        lines.push(format!(
            "  has        64-bit atomics {}, timestamps {}, mappable buffers {}; buffers of {}, bindings of {}, pictures of {} pixels a side",
            has(&a["atomics_64"]),
            has(&a["timestamps"]),
            has(&a["mappable_buffers"]),
            bytes(&a["buffer_bytes_max"]),
            bytes(&a["binding_bytes_max"]),
            a["picture_side_max"],
        ));
    }
    let chosen = &system["chosen"];
    let what = match chosen["backend"].as_str() {
        Some("gpu") => {
            format!("{}, points by {}", word(&chosen["adapter"]), word(&chosen["path"]))
        }
        Some(_) => format!("the CPU renderer on {} threads", system["threads"]),
        None => "nothing".into(),
    };
    lines.push(format!("draws with   {what}"));
    lines.push(format!("  since      {}", word(&chosen["why"])));
    lines.join("\n")
}
