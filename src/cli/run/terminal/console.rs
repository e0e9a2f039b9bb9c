//! Windows' console as a terminal: what its keys would send there.
#![allow(unsafe_code)]

use std::sync::Mutex;

use windows_sys::Win32::Foundation::HANDLE;
use windows_sys::Win32::System::Console::{
    CONSOLE_MODE, ENABLE_ECHO_INPUT, ENABLE_LINE_INPUT, GetConsoleMode, GetStdHandle, INPUT_RECORD,
    KEY_EVENT, PeekConsoleInputW, ReadConsoleInputW, SHIFT_PRESSED, STD_INPUT_HANDLE, SetConsoleMode,
};

/// Its mode as it was before.
static BEFORE: Mutex<Option<CONSOLE_MODE>> = Mutex::new(None);

/// Events that are taken at once.
const EVENTS: usize = 64;

/// Escape's name in winuser.h, and its byte: not every console gives it its character.
const ESCAPE: u16 = 0x1b;
/// What arrows are called there, and the last byte of their sequences.
const ARROWS: [(u16, u8); 4] = [(0x26, b'A'), (0x28, b'B'), (0x27, b'C'), (0x25, b'D')];

fn input() -> HANDLE {
    // SAFETY: nothing is handed over; what is no console's handle is refused by the calls below.
    unsafe { GetStdHandle(STD_INPUT_HANDLE) }
}

fn set_mode(mode: CONSOLE_MODE) -> bool {
    // SAFETY: numbers alone are handed over.
    unsafe { SetConsoleMode(input(), mode) != 0 }
}

pub fn listen() -> bool {
    let mut before = 0;
    // SAFETY: the place is valid.
    if unsafe { GetConsoleMode(input(), &raw mut before) } == 0 {
        return false;
    }
    let listens = set_mode(before & !(ENABLE_LINE_INPUT | ENABLE_ECHO_INPUT));
    if let Ok(mut kept) = BEFORE.lock() {
        *kept = Some(before).filter(|_| listens);
    }
    listens
}

/// What has come since the last time, as a terminal would have sent it.
pub fn typed() -> Vec<u8> {
    let mut events = [INPUT_RECORD::default(); EVENTS];
    let (mut waiting, mut count) = (0, 0);
    // SAFETY: there is room for as many events as are asked for; nothing is waited for.
    let told = unsafe { PeekConsoleInputW(input(), events.as_mut_ptr(), EVENTS as u32, &raw mut waiting) };
    if told == 0 || waiting == 0 {
        return Vec::new();
    }
    // SAFETY: as above, and so many are there.
    if unsafe { ReadConsoleInputW(input(), events.as_mut_ptr(), waiting, &raw mut count) } == 0 {
        return Vec::new();
    }
    events.iter().take(count as usize).flat_map(sent).collect()
}

/// What a terminal sends for an event: nothing but for keys that go down.
fn sent(event: &INPUT_RECORD) -> Vec<u8> {
    if u32::from(event.EventType) != KEY_EVENT {
        return Vec::new();
    }
    // SAFETY: the event says that it is a key's, and any bits are a character.
    let (key, character) = unsafe { (event.Event.KeyEvent, event.Event.KeyEvent.uChar.UnicodeChar) };
    if key.bKeyDown == 0 {
        return Vec::new();
    }
    let arrow = ARROWS.iter().find(|(code, _)| *code == key.wVirtualKeyCode).map(|(_, last)| *last);
    match arrow {
        Some(last) if key.dwControlKeyState & SHIFT_PRESSED != 0 => vec![0x1b, b'[', b'1', b';', b'2', last],
        Some(last) => vec![0x1b, b'[', last],
        None if key.wVirtualKeyCode == ESCAPE => vec![ESCAPE as u8],
        None => u8::try_from(character).ok().filter(|&byte| byte != 0).into_iter().collect(),
    }
}

pub fn restore() {
    if let Some(before) = BEFORE.lock().ok().and_then(|mut kept| kept.take()) {
        set_mode(before);
    }
}
