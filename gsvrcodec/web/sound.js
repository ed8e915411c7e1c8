/** Copied sound, played by the browser and kept in step with the pictures. */

/** Seconds by which pictures may be off before they jump. */
const JUMP = 0.2;
/** Flag of a disposition: play this stream. */
const DEFAULT = 1;

/** Return the first sound that the browser plays, or null. */
export async function openSound(film) {
  const sounds = await film.sounds();
  sounds.sort((a, b) => (b.disposition & DEFAULT) - (a.disposition & DEFAULT));
  for (const { bytes, type } of sounds) {
    const sound = await load(new Blob([bytes], { type }));
    if (sound) return sound;
  }
  return null;
}

function load(blob) {
  const element = new Audio();
  const url = URL.createObjectURL(blob);
  element.preload = "auto";
  element.src = url;
  return new Promise((resolve) => {
    element.onloadedmetadata = () => resolve(new Sound(element, url));
    element.onerror = () => {
      URL.revokeObjectURL(url);
      resolve(null);
    };
  });
}

class Sound {
  constructor(element, url) {
    this.element = element;
    this.url = url;
  }

  /** Fit the pictures at `seconds` of the sound's clock; return the seconds to go on from. */
  follow(seconds, audible) {
    const { element } = this;
    const isInside = seconds >= 0 && seconds < element.duration;
    if (!audible || !isInside) {
      element.pause();
      return seconds;
    }
    if (element.paused) {
      element.currentTime = seconds;
      element.play().catch(() => {}); // a browser may want a touch first
      return seconds;
    }
    if (element.seeking || element.readyState < 3) return seconds;
    const late = element.currentTime - seconds;
    return seconds + (Math.abs(late) > JUMP ? late : late / 10);
  }

  /** Jump with the next `follow`. */
  jump() {
    this.element.pause();
  }

  set muted(value) {
    this.element.muted = value;
  }

  changeVolume(step) {
    this.element.volume = Math.min(Math.max(this.element.volume + step, 0), 1);
  }

  close() {
    this.element.pause();
    this.element.removeAttribute("src");
    URL.revokeObjectURL(this.url);
  }
}
