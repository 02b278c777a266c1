"""The number of threads of linear algebra is the same after estimates as before."""

from threading import Barrier, Thread

from fewruns.threads import BLAS, one_thread


def threads():
    return [each["num_threads"] for each in BLAS.info() if each["user_api"] == "blas"]


def test_blocks_that_overlap_leave_the_number_of_threads_unchanged():
    with BLAS.limit(limits=2, user_api="blas"):
        before, first, second = threads(), Barrier(2), Barrier(2)

        def inner():
            first.wait()  # the outer block has begun
            with one_thread():
                second.wait()
                first.wait()  # the outer block has ended
                assert set(threads()) == {1}

        other = Thread(target=inner)
        other.start()
        with one_thread():
            assert set(threads()) == {1}
            first.wait()
            second.wait()
        first.wait()
        other.join()
        assert threads() == before
        assert set(before) == {2}
