//! Work in the background.

use bevy::tasks::{AsyncComputeTaskPool, Task, TaskPool, futures::check_ready};

/// Work that goes on while frames are drawn. It is given up when dropped.
pub struct Errand<T>(Option<Task<T>>);

impl<T> Default for Errand<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<T: Send + 'static> Errand<T> {
    /// Begins, in place of what was begun before.
    pub fn start(&mut self, work: impl FnOnce() -> T + Send + 'static) {
        let pool = AsyncComputeTaskPool::get_or_init(TaskPool::default);
        self.0 = Some(pool.spawn(async move { work() }));
    }

    /// Whether something has begun whose result was not taken.
    pub fn is_under_way(&self) -> bool {
        self.0.is_some()
    }

    /// The result, once.
    pub fn take(&mut self) -> Option<T> {
        let result = self.0.as_mut().and_then(check_ready);
        if result.is_some() {
            self.0 = None;
        }
        result
    }
}
