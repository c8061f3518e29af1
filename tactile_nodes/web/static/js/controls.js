// The buttons: recording on and off, and a new rest image. The node says what came of it, in a sentence.

const $ = (id) => document.getElementById(id);
const RESTS_MS = 8000;
const GUEST = 'You may watch. Only the account that started the sensor may record and tare.';

export class Controls {
  constructor(link) {
    this.link = link;
    this.recording = null;
    this.bag = '';
    this.busy = false;
    this.idle = $('answer').textContent;
    $('record').addEventListener('click', () => this.act(this.recording?.on ? 'recording_stop' : 'recording_start'));
    $('rest').addEventListener('click', () => this.act('rest_image'));
  }

  /** What the nodes offer now, and whether they record. */
  show(slow, isOpen) {
    const { recording, controls } = slow ?? { recording: null, controls: {} };
    this.recording = recording;
    const on = Boolean(recording?.on);
    const may = isOpen && !this.busy && this.link.mayAct;
    $('record').disabled = !may || !controls.recording_start;
    $('rest').disabled = !may || !controls.rest_image;
    $('record').classList.toggle('on', on);
    $('record-word').textContent = on ? `Stop recording, ${recording.seconds.toFixed(0)} s` : 'Record a bag';
    $('recording-mark').hidden = !on;
    this.showBag(recording);
    if (recording && !recording.well && !recording.bag) this.answer(recording.text, 'refused');
    else if (isOpen && this.link.mayAct === false && !this.answered) this.answer(GUEST, '', false);
  }

  /** Where the bag is, what of it is lost and what for that is needed: the recorder's sentence, a line a clause. */
  showBag(recording) {
    const text = recording?.bag ? recording.text : '';
    const where = !text || text.includes(recording.bag) ? [] : [`recording into ${recording.bag}`];
    const lines = text ? [...where, ...text.split('; ')] : [];
    $('bag').hidden = !text;
    $('bag').classList.toggle('lost', Boolean(recording?.lost));
    if (lines.join('\n') === this.bag) return;
    this.bag = lines.join('\n');
    $('bag').replaceChildren(...lines.map((line) => {
      const made = document.createElement('li');
      made.textContent = line;
      return made;
    }));
    if (text && !this.answered) this.answer('', '', false);
  }

  async act(action, insist = false) {
    this.busy = true;
    $('record').disabled = $('rest').disabled = true;
    const outcome = await this.link.act(action, insist);
    this.busy = false;
    if (outcome.done && action !== 'rest_image') this.answer('', '', false); // the recorder says it, in its own place
    else this.answer(outcome.text, outcome.done ? 'done' : 'refused');
    if (outcome.insistable) this.offer(action);
  }

  /** The person may know better: nothing touches, only the force has drifted. */
  offer(action) {
    const button = document.createElement('button');
    button.type = 'button';
    button.textContent = 'Nothing does: go on';
    button.addEventListener('click', () => this.act(action, true));
    $('answer').append(button);
  }

  answer(text, className, stays = true) {
    const place = $('answer');
    if (place.textContent !== text) place.textContent = text;
    place.className = className;
    place.title = text;
    if (!stays) return;
    clearTimeout(this.answered);
    this.answered = setTimeout(() => {
      this.answered = undefined;
      this.answer(this.bag ? '' : this.idle, '', false);
    }, RESTS_MS);
  }
}
