"""What pages keep instead of working it out at every look."""

from collections.abc import Callable

from server.web.cache import Cache


def test_what_stays_is_found_once_and_the_first_goes_when_there_are_too_many() -> None:
    cache, asked = Cache[int](2), list[int]()

    def find(key: int) -> Callable[[], int]:
        def found() -> int:
            asked.append(key)
            return 10 * key

        return found

    assert [cache.of(key, find(key)) for key in (1, 2, 2, 1, 3)] == [10, 20, 20, 10, 30]
    assert asked == [1, 2, 3]
    assert [cache.of(key, find(key)) for key in (2, 1)] == [20, 10] and asked == [1, 2, 3, 1]


def test_what_does_not_stay_is_found_again_until_it_does() -> None:
    cache, answers = Cache[int](2), iter((1, 2, 3))
    looks = [cache.of("key", lambda: next(answers), stays=lambda at: at > 1) for _ in range(3)]
    assert looks == [1, 2, 2]
