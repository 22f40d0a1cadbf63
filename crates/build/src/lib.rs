//! From scans to an .esker file under a memory bound, and the proof that no point was lost.
