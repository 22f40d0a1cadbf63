//! What the programs do, as calls: build, info, verify, render.
