//! A session's states and what they ask of the program.

use openxr::SessionState;

/// What a change of state asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Duty {
    /// Nothing.
    None,
    /// xrBeginSession.
    Begin,
    /// xrEndSession.
    End,
    /// Leave for good: the wearer, or this program, has asked for it.
    Exit,
    /// The session is about to be lost: build a new one.
    Rebuild,
}

/// Follows a session's states, in whatever order they come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lifecycle {
    running: bool,
}

impl Lifecycle {
    /// Takes a new state.
    pub fn enter(&mut self, state: SessionState) -> Duty {
        match state {
            SessionState::READY if !self.running => {
                self.running = true;
                Duty::Begin
            }
            SessionState::STOPPING if self.running => {
                self.running = false;
                Duty::End
            }
            SessionState::EXITING => Duty::Exit,
            SessionState::LOSS_PENDING => Duty::Rebuild,
            _ => Duty::None,
        }
    }

    /// Whether frames are to be waited for, begun and ended.
    pub fn running(&self) -> bool {
        self.running
    }
}

/// Why nothing is shown in a state, where views were located or not.
pub fn why_dark(state: SessionState, located: bool) -> &'static str {
    match state {
        SessionState::UNKNOWN | SessionState::IDLE => {
            "the runtime has not made the session ready: put the headset on, or look at its own window"
        }
        SessionState::READY | SessionState::SYNCHRONIZED => {
            "the runtime shows no pictures of this program: end the other one, or close the runtime's menu"
        }
        SessionState::VISIBLE | SessionState::FOCUSED if located => {
            "the runtime wants no pictures now: put the headset on"
        }
        SessionState::VISIBLE | SessionState::FOCUSED => {
            "the runtime tells no views that can be shown: its fields of view are empty or too wide, or the \
             headset is not tracked"
        }
        _ => "the runtime is about to end the session",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use openxr::SessionState as State;

    #[test]
    fn frames_run_from_ready_to_stopping() {
        let mut life = Lifecycle::default();
        let states = [
            (State::IDLE, Duty::None, false),
            (State::READY, Duty::Begin, true),
            (State::SYNCHRONIZED, Duty::None, true),
            (State::VISIBLE, Duty::None, true),
            (State::FOCUSED, Duty::None, true),
            (State::VISIBLE, Duty::None, true),
            (State::SYNCHRONIZED, Duty::None, true),
            (State::STOPPING, Duty::End, false),
            (State::IDLE, Duty::None, false),
            (State::READY, Duty::Begin, true),
            (State::STOPPING, Duty::End, false),
            (State::IDLE, Duty::None, false),
            (State::EXITING, Duty::Exit, false),
        ];
        for (state, duty, running) in states {
            assert_eq!((life.enter(state), life.running()), (duty, running), "{state:?}");
        }
    }

    #[test]
    fn states_that_repeat_ask_for_nothing_twice() {
        let mut life = Lifecycle::default();
        assert_eq!(life.enter(State::STOPPING), Duty::None);
        assert_eq!(life.enter(State::READY), Duty::Begin);
        assert_eq!(life.enter(State::READY), Duty::None);
        assert_eq!(life.enter(State::LOSS_PENDING), Duty::Rebuild);
    }
}
