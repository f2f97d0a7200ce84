use rayon::ThreadPoolBuilder;

/// Does some work on a thread pool of its own, so that a program can do several things, each with its number of threads; 0 for
/// one a core. Where no threads can be had, the calling one does all.
pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    install(ThreadPoolBuilder::new().num_threads(threads), work)
}

/// As [`on_threads`], on threads that give way: to Blender's own, which draw its window, and to those that make pictures for it.
/// Work that uses every core would have them wait otherwise.
pub fn in_background<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    install(ThreadPoolBuilder::new().num_threads(threads).start_handler(|_| give_way()), work)
}

fn install<T: Send>(pool: ThreadPoolBuilder, work: impl FnOnce() -> T + Send) -> T {
    match pool.build() {
        Ok(pool) => pool.install(work),
        Err(_) => work(),
    }
}

/// Takes 10 more of niceness, which Linux keeps for each thread. A system that refuses has the thread work as it is.
#[cfg(target_os = "linux")]
fn give_way() {
    let _ = rustix::process::nice(10);
}

/// Takes a priority below normal, on Windows the one of that name.
#[cfg(not(target_os = "linux"))]
fn give_way() {
    /// Of 0 to 99, where threads have 50 by themselves.
    const BELOW_NORMAL: u8 = 22;
    let priority = thread_priority::ThreadPriorityValue::try_from(BELOW_NORMAL).expect("of 0 to 99");
    let _ = thread_priority::set_current_thread_priority(thread_priority::ThreadPriority::Crossplatform(
        priority,
    ));
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    /// Of each thread of the pool, 19th of the fields that Linux tells of it (`proc_pid_stat(5)`).
    fn niceness() -> Vec<i32> {
        rayon::broadcast(|_| {
            let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
            let after_name = stat.rsplit_once(") ").unwrap().1;
            after_name.split(' ').nth(16).unwrap().parse().unwrap()
        })
    }

    #[test]
    fn threads_in_the_background_give_way_and_no_others() {
        let [others, background] = [on_threads(2, niceness), in_background(2, niceness)];
        assert!(background.iter().all(|nice| *nice == (others[0] + 10).min(19)), "{background:?}");
        assert_eq!((background.len(), on_threads(2, niceness)), (2, others));
    }
}
