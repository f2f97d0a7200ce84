use rayon::ThreadPoolBuilder;

/// What threads give way to.
#[derive(Clone, Copy)]
enum Before {
    /// Blender's threads, which draw its window.
    Window,
    /// Those, and the threads that make pictures for it.
    Pictures,
}

/// Does some work on a thread pool of its own, so that a program can do several things, each with its number of threads; 0 for
/// one a core. Where no threads can be had, the calling one does all.
pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    install(ThreadPoolBuilder::new().num_threads(threads), work)
}

/// As [`on_threads`], on threads that give way to Blender's own, which draw its window: to use every core for the picture of an
/// edit would hold up the next edit.
pub fn beside_window<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    install(giving_way(threads, Before::Window), work)
}

/// As [`on_threads`], on threads that give way to Blender's own and to those that make pictures for its window. Work that uses
/// every core would have them wait otherwise.
pub fn in_background<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    install(giving_way(threads, Before::Pictures), work)
}

fn giving_way(threads: usize, before: Before) -> ThreadPoolBuilder {
    ThreadPoolBuilder::new().num_threads(threads).start_handler(move |_| before.give_way())
}

fn install<T: Send>(pool: ThreadPoolBuilder, work: impl FnOnce() -> T + Send) -> T {
    match pool.build() {
        Ok(pool) => pool.install(work),
        Err(_) => work(),
    }
}

impl Before {
    /// Takes more of niceness, which Linux keeps for each thread: with 5 more, a thread gets a third of what another one gets of a
    /// core that both want; with 10 more, a ninth. A system that refuses has the thread work as it is.
    #[cfg(target_os = "linux")]
    fn give_way(self) {
        let _ = rustix::process::nice(match self {
            Self::Window => 5,
            Self::Pictures => 15,
        });
    }

    /// Takes a priority below normal, on Windows the one of that name. There is no step between, so threads that make pictures
    /// keep theirs.
    #[cfg(not(target_os = "linux"))]
    fn give_way(self) {
        /// Of 0 to 99, where threads have 50 by themselves.
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

    /// Of each thread of the pool, 19th of the fields that Linux tells of it (`proc_pid_stat(5)`).
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
