//! Positioned reads at addresses: `http://`, `https://`, `s3://`, `gs://` and `az://`. A file is
//! read in blocks, of which neighbours are fetched in one request and many requests run at a time;
//! what was fetched stays in memory and in a bounded folder of the user's cache. A file that
//! changes while it is read, a server that ignores ranges, and short answers are errors. Steps of
//! divided builds also write to object storage, small objects at once and large ones in parts.
//! Credentials come from the standard variables of the environment alone, and are in no message.

mod address;
mod blocks;
mod connection;
mod disk;
mod fetch;
mod place;
mod pool;
mod secrets;
mod source;
mod threads;

pub use disk::Disk;
pub use place::ObjectPlace;
pub use pool::{Limits, Pool};
pub use source::Remote;

use esker_points::read_at::ReadAt;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Lets this process open addresses wherever it opens files ([`esker_points::read_at::open`]), and
/// keep the steps of divided builds in object storage ([`esker_points::objects::at`]).
/// `disk` keeps what was fetched; `None` keeps it in memory alone. All files share `pool`.
pub fn install(disk: Option<Disk>, pool: Pool) -> Arc<Pool> {
    let (disk, pool) = (disk.map(Arc::new), Arc::new(pool));
    let shared = Arc::clone(&pool);
    let of_places = Arc::clone(&pool);
    esker_points::objects::set_remote(Box::new(move |address| {
        let place = ObjectPlace::open(address, &of_places).map_err(secrets::without)?;
        Ok(Box::new(place))
    }));
    let recent: Mutex<Vec<Recent>> = Mutex::default();
    esker_points::read_at::set_remote(Box::new(move |address| {
        let find = |recent: &mut Vec<Recent>| {
            recent.retain(|one| one.opened.elapsed() < SAME_FILE && !one.file.has_changed());
            recent.iter().find(|one| one.address == address).map(|one| Arc::clone(&one.file))
        };
        let lock = || recent.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(file) = find(&mut lock()) {
            return Ok(file as Arc<dyn ReadAt>);
        }
        let file = Remote::open_in(address, disk.clone(), &pool).map_err(secrets::without)?;
        let file = Arc::new(file);
        let (address, opened) = (address.to_owned(), Instant::now());
        lock().push(Recent { address, opened, file: Arc::clone(&file) });
        Ok(file)
    }));
    shared
}

/// Time for which a file that is opened again is the one that was opened before: a command first
/// looks what its inputs are.
const SAME_FILE: Duration = Duration::from_secs(3);

/// A file that was opened.
struct Recent {
    address: String,
    opened: Instant,
    file: Arc<Remote>,
}
