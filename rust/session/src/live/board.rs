use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Share of the time for other pictures while the active one is dragged.
const SHARE: f64 = 0.1;
/// A drag is over when nothing was dragged for so long, although there was time for it.
const DRAG_PAUSE: Duration = Duration::from_millis(250);
/// Time after which who waits looks again whether it was closed, or a drag is over.
const LOOK_AGAIN: Duration = Duration::from_millis(20);

/// Purpose of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// A light is dragged.
    Drag,
    /// Nothing of a request was shown yet.
    First,
    /// Better pictures.
    Refine,
}

/// Shots that take turns: they share one device and one budget of memory, and one at a time makes its picture. The
/// active one comes first; the others follow in turn, and all get a first picture before any but the active one gets a
/// better one.
#[derive(Clone, Debug, Default)]
pub struct Board(Arc<Inner>);

#[derive(Debug, Default)]
struct Inner {
    state: Mutex<BoardState>,
    changed: Condvar,
    /// Number of the newest seat.
    seats: AtomicU64,
}

#[derive(Debug, Default)]
struct BoardState {
    /// Shots on this board.
    members: usize,
    /// Number of the shot that somebody looks at.
    active: Option<u64>,
    /// Those that wait, the one that has waited longest first.
    waiting: Vec<Waiting>,
    /// Purpose of the picture that is being made.
    taken: Option<Stage>,
    /// The shot that nobody looks at and that prepares what its better pictures need.
    preparing: Option<u64>,
    drag: Option<Drag>,
}

#[derive(Clone, Copy, Debug)]
struct Waiting {
    seat: u64,
    stage: Stage,
}

/// A drag seen in the active picture.
#[derive(Clone, Copy, Debug)]
struct Drag {
    began: Instant,
    last: Instant,
    /// Time that the others have had since it began.
    others: Duration,
}

/// The place of one shot on a board.
#[derive(Debug)]
pub(super) struct Seat {
    board: Board,
    number: u64,
}

/// A turn, which ends when it is dropped.
pub(super) struct Turn {
    seat: Arc<Seat>,
    stage: Stage,
    began: Instant,
}

/// Leave to prepare, which ends when it is dropped.
pub(super) struct Preparation<'a>(&'a Seat);

impl BoardState {
    /// The one of those that wait whose turn is next; none if the active picture should not be held up by any.
    fn next(&self, now: Instant) -> Option<u64> {
        let is_active = |waiting: &Waiting| Some(waiting.seat) == self.active;
        // Of equals the one that has waited longest.
        let first = |rank: &dyn Fn(&Waiting) -> bool| {
            self.waiting.iter().min_by_key(|waiting| (waiting.stage == Stage::Refine, rank(waiting)))
        };
        let next = match self.drag.filter(|drag| !drag.is_over(now)) {
            None => first(&|waiting| !is_active(waiting)),
            Some(drag) if drag.owes_others(now) => first(&is_active),
            Some(_) => self.waiting.iter().find(|waiting| is_active(waiting)),
        };
        next.map(|waiting| waiting.seat)
    }

    /// Notes a turn that ends.
    fn note(&mut self, is_active: bool, stage: Stage, began: Instant, now: Instant) {
        self.drag = self.drag.filter(|drag| !drag.is_over(began));
        if is_active && stage == Stage::Drag {
            let drag = self.drag.get_or_insert(Drag { began, last: now, others: Duration::ZERO });
            drag.last = now;
        } else if let Some(drag) = self.drag.as_mut().filter(|_| !is_active) {
            drag.others += now.duration_since(began);
            // The active one could not go on before.
            drag.last = now;
        }
    }
}

impl BoardState {
    /// True while a shot should leave the machine to a picture that somebody waits for: another shot prepares what
    /// only its better pictures need.
    fn holds(&self, seat: u64, now: Instant) -> bool {
        if self.active.is_none_or(|active| active == seat) {
            return false;
        }
        self.drag.is_some_and(|drag| !drag.is_over(now)) || self.is_urgent()
    }

    /// Gives a shot leave to prepare, if it may: of those that nobody looks at one at a time, as not all of what is
    /// prepared can be put off once it has begun.
    fn begin_to_prepare(&mut self, seat: u64, now: Instant) -> bool {
        let is_aside = self.active.is_some_and(|active| active != seat);
        let may = !(self.holds(seat, now) || is_aside && self.preparing.is_some());
        if may && is_aside {
            self.preparing = Some(seat);
        }
        may
    }

    /// True while some shot needs the machine for a picture that somebody waits for.
    fn is_urgent(&self) -> bool {
        let mut stages = self.waiting.iter().map(|waiting| waiting.stage).chain(self.taken);
        stages.any(|stage| stage != Stage::Refine)
    }
}

impl Drag {
    fn is_over(&self, now: Instant) -> bool {
        now.duration_since(self.last) > DRAG_PAUSE
    }

    fn owes_others(&self, now: Instant) -> bool {
        self.others.as_secs_f64() < SHARE * now.duration_since(self.began).as_secs_f64()
    }
}

impl Board {
    /// A place for one more shot.
    pub(super) fn seat(&self) -> Arc<Seat> {
        let number = self.0.seats.fetch_add(1, Ordering::Relaxed);
        self.lock().members += 1;
        Arc::new(Seat { board: self.clone(), number })
    }

    /// True while some shot needs the machine for a picture that somebody waits for.
    pub(super) fn is_urgent(&self) -> bool {
        self.lock().is_urgent()
    }

    fn lock(&self) -> MutexGuard<'_, BoardState> {
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Seat {
    /// Makes this shot the active one.
    pub fn attend(&self) {
        self.board.lock().active = Some(self.number);
        self.board.0.changed.notify_all();
    }

    /// True unless somebody looks at another shot.
    pub fn is_attended(&self) -> bool {
        self.board.lock().active.is_none_or(|active| active == self.number)
    }

    /// Shots that share the memory.
    pub fn members(&self) -> usize {
        self.board.lock().members
    }

    /// True while this shot should not prepare anything: see [`Self::wait_to_prepare`].
    pub fn is_held(&self) -> bool {
        self.board.lock().holds(self.number, Instant::now())
    }

    /// Waits until this shot may prepare what its better pictures need: while another one is looked at, not beside a
    /// drag, a picture that somebody waits for, or another unseen shot that prepares. None if `stop` became true before.
    pub fn wait_to_prepare(&self, stop: &dyn Fn() -> bool) -> Option<Preparation<'_>> {
        while !stop() {
            let mut state = self.board.lock();
            if state.begin_to_prepare(self.number, Instant::now()) {
                return Some(Preparation(self));
            }
            let waited = self.board.0.changed.wait_timeout(state, LOOK_AGAIN);
            drop(waited.unwrap_or_else(PoisonError::into_inner));
        }
        None
    }

    /// Waits for a turn; none if `stop` became true before.
    pub fn turn(self: &Arc<Self>, stage: Stage, stop: impl Fn() -> bool) -> Option<Turn> {
        let mut state = self.board.lock();
        state.waiting.push(Waiting { seat: self.number, stage });
        let is_mine =
            |state: &BoardState| state.taken.is_none() && state.next(Instant::now()) == Some(self.number);
        let mut stopped = false;
        while !(stopped || is_mine(&state)) {
            let waited = self.board.0.changed.wait_timeout(state, LOOK_AGAIN);
            drop(waited.unwrap_or_else(PoisonError::into_inner).0);
            // It takes a lock of its own.
            stopped = stop();
            state = self.board.lock();
        }
        state.waiting.retain(|waiting| waiting.seat != self.number);
        if stopped {
            return None;
        }
        state.taken = Some(stage);
        Some(Turn { seat: self.clone(), stage, began: Instant::now() })
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        let mut state = self.board.lock();
        state.members -= 1;
        if state.active == Some(self.number) {
            (state.active, state.drag) = (None, None);
        }
    }
}

impl Drop for Preparation<'_> {
    fn drop(&mut self) {
        let Self(seat) = self;
        let mut state = seat.board.lock();
        state.preparing = state.preparing.filter(|preparing| *preparing != seat.number);
        drop(state);
        seat.board.0.changed.notify_all();
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let board = &self.seat.board;
        let mut state = board.lock();
        let is_active = state.active == Some(self.seat.number);
        state.note(is_active, self.stage, self.began, Instant::now());
        state.taken = None;
        drop(state);
        board.0.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    fn state(active: u64, waiting: &[(u64, Stage)]) -> BoardState {
        let waiting = waiting.iter().map(|(seat, stage)| Waiting { seat: *seat, stage: *stage }).collect();
        BoardState { active: Some(active), waiting, ..BoardState::default() }
    }

    #[test]
    fn the_active_picture_is_first_and_first_pictures_come_before_better_ones() {
        use Stage::{Drag, First, Refine};
        let now = Instant::now();
        let next = |active, waiting: &[(u64, Stage)]| state(active, waiting).next(now);
        assert_eq!(next(2, &[(0, First), (1, Drag), (2, First)]), Some(2));
        assert_eq!(next(2, &[(1, First), (0, First), (2, Refine)]), Some(1), "the one that waits longest");
        assert_eq!(next(2, &[(1, Refine), (0, Refine), (2, Refine)]), Some(2));
        assert_eq!(next(7, &[(1, Refine), (0, Refine)]), Some(1));
        assert_eq!(next(7, &[]), None);
    }

    #[test]
    fn others_have_their_share_of_a_drag_and_no_more() {
        let waiting = [(0, Stage::Drag), (1, Stage::Drag)];
        let (began, mut state) = (Instant::now(), state(1, &waiting));
        state.note(true, Stage::Drag, began, began + at(100));
        assert_eq!(state.next(began + at(100)), Some(0), "10 ms are owed");
        state.note(false, Stage::Drag, began + at(100), began + at(130));
        assert_eq!(state.next(began + at(130)), Some(1), "30 ms are more than its share");
        state.waiting.pop();
        assert_eq!(state.next(began + at(131)), None, "and the active one may come at any time");
        assert_eq!(state.next(began + at(310)), Some(0), "until it has been paid for");
        state.note(false, Stage::Drag, began + at(310), began + at(700));
        assert_eq!(state.next(began + at(800)), None, "a long turn of another ends no drag");
        assert_eq!(state.next(began + at(700) + DRAG_PAUSE + at(1)), Some(0), "a pause does");
        state.note(true, Stage::Drag, began + at(1200), began + at(1210));
        assert_eq!(state.drag.unwrap().others, Duration::ZERO, "the next one counts anew");
    }

    #[test]
    fn nobody_prepares_beside_a_drag_or_a_first_picture_but_the_active_shot() {
        let (began, mut state) = (Instant::now(), state(1, &[]));
        assert!(!state.holds(0, began), "at rest");
        state.note(true, Stage::Drag, began, began + at(100));
        assert!(state.holds(0, began + at(100)) && !state.holds(1, began + at(100)));
        assert!(state.holds(0, began + at(100) + DRAG_PAUSE), "the mouse stands still");
        let later = began + at(101) + DRAG_PAUSE;
        assert!(!state.holds(0, later), "the drag is over");
        state.taken = Some(Stage::Refine);
        assert!(!state.holds(0, later), "better pictures do not matter more");
        state.waiting.push(Waiting { seat: 2, stage: Stage::First });
        assert!(state.holds(0, later) && state.holds(2, later) && !state.holds(1, later));
        state.active = None;
        assert!(!state.holds(0, later), "nobody looks at another one");
    }

    #[test]
    fn one_at_a_time_prepares_beside_the_active_shot() {
        let (now, mut state) = (Instant::now(), state(1, &[]));
        assert!(state.begin_to_prepare(0, now) && !state.begin_to_prepare(2, now));
        assert!(
            state.begin_to_prepare(1, now) && state.preparing == Some(0),
            "the active one needs no leave"
        );
        state.preparing = None;
        state.note(true, Stage::Drag, now, now);
        assert!(!state.begin_to_prepare(2, now) && state.preparing.is_none(), "a drag");
        state.active = None;
        assert!(state.begin_to_prepare(0, now) && state.begin_to_prepare(2, now), "all are looked at");
    }

    #[test]
    fn who_has_prepared_lets_the_next_one_do_so() {
        let board = Board::default();
        let [active, second, third] = [board.seat(), board.seat(), board.seat()];
        active.attend();
        let preparation = second.wait_to_prepare(&|| false);
        let begun = Instant::now();
        assert!(third.wait_to_prepare(&|| begun.elapsed() > at(30)).is_none());
        drop(preparation);
        assert!(third.wait_to_prepare(&|| false).is_some());
    }

    #[test]
    fn who_waits_to_prepare_goes_on_at_rest_and_ends_when_closed() {
        let board = Board::default();
        let [active, other] = [board.seat(), board.seat()];
        active.attend();
        let turn = active.turn(Stage::First, || false).unwrap();
        assert!(other.is_held() && !active.is_held());
        assert!(other.wait_to_prepare(&|| true).is_none());
        let waits = std::thread::spawn({
            let other = other.clone();
            move || drop(other.wait_to_prepare(&|| false))
        });
        std::thread::sleep(at(30));
        assert!(!waits.is_finished());
        drop(turn);
        waits.join().unwrap();
        assert!(!other.is_held());
    }

    #[test]
    fn one_at_a_time_makes_its_picture_and_who_is_closed_waits_no_more() {
        let board = Board::default();
        let [first, second] = [board.seat(), board.seat()];
        let turn = first.turn(Stage::First, || false).unwrap();
        assert!(board.is_urgent() && second.turn(Stage::First, || true).is_none());
        let waits = std::thread::spawn({
            let second = second.clone();
            move || second.turn(Stage::Refine, || false).is_some()
        });
        std::thread::sleep(at(30));
        assert!(!waits.is_finished());
        drop(turn);
        assert!(waits.join().unwrap() && !board.is_urgent());
        assert_eq!(first.members(), 2);
        second.attend();
        assert!(second.is_attended() && !first.is_attended());
        drop(second);
        assert!(first.is_attended() && first.members() == 1, "nobody looks at another one");
    }
}
