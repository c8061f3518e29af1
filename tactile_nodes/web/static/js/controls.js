// The buttons: recording on and off, and a new rest image. The node reports the result in a sentence.

const $ = (id) => document.getElementById(id);
const RESTS_MS = 8000;
const GUEST = 'You may watch. Only the user who started the sensor may record and tare.';

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

  /** Enable the buttons whose services exist, and show whether a recording runs. */
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

  /** Path of the bag and lost messages: the recorder's text, one line per clause. */
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
    if (outcome.done && action !== 'rest_image') this.answer('', '', false); // the recorder reports it in its own place
    else this.answer(outcome.text, outcome.done ? 'done' : 'refused');
    if (outcome.insistable) this.offer(action);
  }

  /** Let the person insist: there may be no contact, only a drifted force. */
  offer(action) {
    const button = document.createElement('button');
    button.type = 'button';
    button.textContent = 'No contact: continue';
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
