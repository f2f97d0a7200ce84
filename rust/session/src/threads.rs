/// Does some work on a thread pool of its own, so that a program can do several things, each with its number of threads; 0 for
/// one a core. Where no threads can be had, the calling one does all.
pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.install(work),
        Err(_) => work(),
    }
}
