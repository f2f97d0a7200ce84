use rayon::ThreadPoolBuilder;

/// Threads that others give way to.
#[derive(Clone, Copy)]
enum GivesWayTo {
    /// Blender's threads, which draw its window.
    Window,
    /// Those, and the threads that make pictures for it.
    Pictures,
}

/// Runs work on a thread pool of its own; 0 threads means one per core. Without threads the calling one does all.
pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    install(ThreadPoolBuilder::new().num_threads(threads), work)
}

/// [`on_threads`] at a lower priority than Blender's own threads, which draw its window. Using every core for one edit
/// would hold up the next.
pub fn beside_window<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    install(giving_way(threads, GivesWayTo::Window), work)
}

/// [`on_threads`] at a lower priority than Blender's own threads and those that render for its window.
pub fn in_background<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    install(giving_way(threads, GivesWayTo::Pictures), work)
}

fn giving_way(threads: usize, before: GivesWayTo) -> ThreadPoolBuilder {
    ThreadPoolBuilder::new().num_threads(threads).start_handler(move |_| before.give_way())
}

fn install<T: Send>(pool: ThreadPoolBuilder, work: impl FnOnce() -> T + Send) -> T {
    match pool.build() {
        Ok(pool) => pool.install(work),
        Err(_) => work(),
    }
}

impl GivesWayTo {
    /// Raises the niceness, which Linux keeps for each thread. At 5 more a thread gets a third of a contended core, at
    /// 10 more a ninth. If the system refuses, the thread works as it is.
    #[cfg(target_os = "linux")]
    fn give_way(self) {
        let _ = rustix::process::nice(match self {
            Self::Window => 5,
            Self::Pictures => 15,
        });
    }

    /// Sets a priority below normal, the one of that name on Windows. There is no step between: threads that make
    /// pictures keep theirs.
    #[cfg(not(target_os = "linux"))]
    fn give_way(self) {
        /// Priority of 0 to 99; threads have 50 by default.
        const BELOW_NORMAL: u8 = 22;
        if matches!(self, Self::Pictures) {
            let priority = thread_priority::ThreadPriorityValue::try_from(BELOW_NORMAL).expect("of 0 to 99");
            let _ = thread_priority::set_current_thread_priority(
                thread_priority::ThreadPriority::Crossplatform(priority),
            );
        }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    /// Niceness of each thread of the pool: the 19th field in `proc_pid_stat(5)`.
    fn niceness() -> Vec<i32> {
        rayon::broadcast(|_| {
            let stat = std::fs::read_to_string("/proc/thread-self/stat").expect("a thread");
            let after_name = stat.rsplit_once(") ").expect("a name").1;
            after_name.split(' ').nth(16).and_then(|niceness| niceness.parse().ok()).expect("a niceness")
        })
    }

    #[test]
    fn threads_give_way_to_the_window_and_those_in_the_background_to_pictures_too() {
        let [others, pictures, background] =
            [on_threads(2, niceness), beside_window(2, niceness), in_background(2, niceness)];
        let nicer = |by: i32| vec![(others[0] + by).min(19); 2];
        assert_eq!((pictures, background), (nicer(5), nicer(15)));
        assert_eq!(on_threads(2, niceness), others);
    }
}
