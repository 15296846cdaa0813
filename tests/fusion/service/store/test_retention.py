"""Old rows are removed, and none that anybody still needs."""

from __future__ import annotations

from fusion.service.jobs import JobKind, JobProgress, JobRequest
from fusion.service.store import AuditEntry, Store

DAY = 86_400.0


def submitted(store: Store, solution: str = "", after: tuple[str, ...] = ()) -> str:
    request = JobRequest(JobKind.RUN, "ball", "ann", {"solution": solution}, after=after)
    return store.submit(request).id


def test_ended_jobs_go_and_others_stay(new_url) -> None:
    now = 2e9
    with Store(new_url(), clock=lambda: now) as store:
        old, needed, running = (submitted(store, name) for name in ("a", "b", "c"))
        for identity in (old, needed):
            assert store.claim("w", 30.0).id == identity
            store.note(identity, "a line")
            store.finish(identity, "w", {})
        assert store.claim("w", 30.0).id == running
        store.note(running, "a line")
        later = submitted(store, "d", (needed,))
        now += 6.0 * DAY
        store.renew(running, "w", 30.0, JobProgress("fuse", "items", 1, 2))
        assert store.retention.remove_jobs(10.0 * DAY) == 0
        assert store.retention.remove_events(5.0 * DAY) == 8
        assert {event.job for event in store.events()} == {running, later}
        now += 30.0 * DAY
        assert store.retention.remove_jobs(10.0 * DAY) == 1
        assert [job.id for job in store.jobs()] == [later, running, needed]
        assert store.retention.remove_events(5.0 * DAY) == 0
        assert any("text" in event.content for event in store.events(job=running))
        store.finish(running, "w", {})
        assert store.claim("w", 30.0).id == later


def test_numbers_go_on_when_all_else_is_gone(new_url) -> None:
    now = 2e9
    with Store(new_url(), clock=lambda: now) as store:
        for _ in range(1200):
            store.audit.add(AuditEntry("ann", "submit"))
        first, last = submitted(store), submitted(store)
        for job in (first, last):
            store.cancel(job)
        number = store.events()[-1].number
        now += 1000.0 * DAY
        ages = float("inf"), DAY
        counts = [store.retention.remove_entries(age) for age in ages]
        assert counts == [0, 1199]
        assert [store.retention.remove_events(age) for age in ages] == [0, 3]
        assert [store.retention.remove_jobs(age) for age in ages] == [0, 1]
        # Also when the clock is set back.
        now -= 1000.0 * DAY
        assert submitted(store) > last
        assert store.events()[-1].number > number
        store.audit.add(AuditEntry("ann", "submit"))
        assert [entry.number for entry in store.audit.entries()] == [1201, 1200]
