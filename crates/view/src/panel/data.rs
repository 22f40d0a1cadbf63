//! What the panel shows, and the parts of its state that outlive a pass.

use crate::clouds::Cloud;
use crate::counters::Counters;
use crate::shots::Message;
use crate::times::Times;
use crate::tools::ToolName;
use esker_engine::Forest;
use esker_engine::cameras::classes::ClassCount;
use esker_engine::cameras::legend::Legend;
use std::sync::Arc;

/// Data that the panel shows.
pub struct PanelData<'a> {
    /// The file.
    pub file: &'a Arc<Forest>,
    /// Name of the file.
    pub name: &'a str,
    /// Numbers of points and nodes, in words.
    pub about: &'a str,
    /// Scans that the file was built from.
    pub clouds: &'a [Cloud],
    /// Whether the file was built from scans, and can be kept.
    pub is_built: bool,
    /// Names of the files that are shown together, which can be hidden one by one.
    pub together: &'a [String],
    /// Extent along the three axes in the scan's coordinates, if there are points.
    pub extent: Option<[[f64; 2]; 3]>,
    /// Name of the coordinate reference system.
    pub crs: Option<&'a str>,
    /// Notes on what was left out of the file or is unusual in it.
    pub notes: &'a [String],
    /// Unit of the file's lengths, if the file names one.
    pub unit: Option<&'a str>,
    /// Whether horizontal coordinates are degrees.
    pub has_degrees: bool,
    /// Whether a fault, painted over the picture, prevents new pictures.
    pub is_failed: bool,
    /// Frame times of the last seconds.
    pub times: &'a Times,
    /// Counts of the newest frame.
    pub counters: &'a Counters,
    /// Anonymous memory of this process, bytes; 0 if the system does not report it.
    pub anon_bytes: u64,
    /// Names of what draws the scene and what paints the window.
    pub backend: &'a str,
    /// Names of the colour sources that are offered.
    pub sources: &'a [String],
    /// Whether normals tell the front of surfaces from the back.
    pub has_fronts: bool,
    /// Whether points have flags.
    pub has_flags: bool,
    /// Classes that occur.
    pub classes: &'a [ClassCount],
    /// Legend of the colours.
    pub legend: Option<&'a Legend>,
    /// Measurements by clicks.
    pub measured: &'a [String],
    /// Names and values of the point that was clicked last.
    pub picked: &'a [(String, String)],
    /// Size of the picture, pixels.
    pub picture: [u32; 2],
    /// Speed of the camera, the file's unit a second.
    pub speed: f64,
    /// The active tool.
    pub tool: ToolName,
    /// Whether the speed is fixed, instead of following the distance of what is in view.
    pub has_fixed_speed: bool,
    /// Whether pictures are parallel (orthographic) ones.
    pub is_parallel: bool,
    /// Why another axis than z points upwards, if that was guessed.
    pub up_note: Option<&'a str>,
    /// Whether the cut is frozen.
    pub is_frozen: bool,
    /// Faults, the newest last.
    pub faults: &'a [String],
    /// Outcome of the last picture: where it was written, or why not.
    pub message: Option<&'a Message>,
}
