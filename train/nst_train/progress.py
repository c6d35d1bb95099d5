"""Progress of training: a bar on a terminal, plain lines in a pipe."""

import sys
from types import TracebackType

from tqdm import tqdm


class Progress:
    """Counts epochs."""

    def __init__(self, epochs: int, done: int) -> None:
        self.epochs = epochs
        self.epoch = done
        self.bar = None
        if sys.stderr.isatty():
            self.bar = tqdm(total=epochs, initial=done, unit="epoch", dynamic_ncols=True)

    def update(self, loss: float, seconds: float, report: bool) -> None:
        """Counts one more epoch; with `report`, prints a line if the output is a pipe."""
        self.epoch += 1
        if self.bar is not None:
            self.bar.set_postfix(loss=f"{loss:.5g}", refresh=False)
            self.bar.update()
        elif report or self.epoch == 1:
            line = f"epoch {self.epoch}/{self.epochs}  loss {loss:.5g}  {seconds:.1f} s"
            print(line, flush=True)

    def __enter__(self) -> "Progress":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self.bar is not None:
            self.bar.close()
