"""Published figures as PDF, made from their PNG files, because PDFs are not in the repository."""

from pathlib import Path

from matplotlib import pyplot as plt

PUBLISHED = Path(__file__).resolve().parents[2] / "figures" / "spmd"
RESOLUTION = 300  # [pixels per inch] of the PNG files


def write_pdf(name, folder):
    """Write a published figure to a folder as a PDF of the same size."""
    pixels = plt.imread(PUBLISHED / f"{name}.png")
    drawn = plt.figure(figsize=(pixels.shape[1] / RESOLUTION, pixels.shape[0] / RESOLUTION), dpi=RESOLUTION)
    drawn.figimage(pixels)
    drawn.savefig(folder / f"{name}.pdf", metadata={"CreationDate": None})
    plt.close(drawn)
