// Which part of the picture is seen, and how large: the place (x, y) on the canvas shows the
// point ((x - left) / scale, (y - top) / scale) of the picture. All lengths are in pixels of
// the canvas.

/** The most pixels of the canvas that a pixel of the picture may be wide. */
const LARGEST = 64;

/** A view that shows the whole picture, centred. */
export function fit(canvas, picture) {
  const scale = Math.min(canvas.width / picture.width, canvas.height / picture.height);
  return inside({ scale, left: 0, top: 0 }, canvas, picture);
}

/** Zooms by a factor so that the point under (x, y) stays there. */
export function zoomAt(view, x, y, factor, canvas, picture) {
  const least = fit(canvas, picture).scale;
  const scale = Math.min(Math.max(view.scale * factor, least), Math.max(LARGEST, least));
  const kept = scale / view.scale;
  return inside(
    { scale, left: x - (x - view.left) * kept, top: y - (y - view.top) * kept },
    canvas,
    picture,
  );
}

/** Moves the picture. */
export function pan(view, dx, dy, canvas, picture) {
  return inside({ ...view, left: view.left + dx, top: view.top + dy }, canvas, picture);
}

/** Moves the picture as little as is needed to show one of its pixels whole. */
export function reveal(view, pixel, canvas, picture) {
  const shift = (start, end) => Math.max(0, -start) - Math.max(0, end);
  const x = view.left + pixel.x * view.scale;
  const y = view.top + pixel.y * view.scale;
  const dx = shift(x, x + view.scale - canvas.width);
  const dy = shift(y, y + view.scale - canvas.height);
  return pan(view, dx, dy, canvas, picture);
}

/** The pixel of the picture at a place on the canvas, or null. */
export function pixelAt(view, x, y, picture) {
  const pixel = {
    x: Math.floor((x - view.left) / view.scale),
    y: Math.floor((y - view.top) / view.scale),
  };
  const within =
    pixel.x >= 0 && pixel.y >= 0 && pixel.x < picture.width && pixel.y < picture.height;
  return within ? pixel : null;
}

/** A view without needless margins: the picture fills the canvas, or is centred in it. */
function inside(view, canvas, picture) {
  const axis = (start, room, length) =>
    length <= room ? (room - length) / 2 : Math.min(Math.max(start, room - length), 0);
  return {
    scale: view.scale,
    left: axis(view.left, canvas.width, picture.width * view.scale),
    top: axis(view.top, canvas.height, picture.height * view.scale),
  };
}
