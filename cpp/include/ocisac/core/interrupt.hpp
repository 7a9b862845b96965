// Lets a program end a long computation: Ctrl-C in Python.
#pragma once

namespace ocisac {

// Called about every 50 ms by computations that may take long, in the thread that called the library, never in its
// helpers. What it throws ends the computation. nullptr: none. To be set before computations begin.
using InterruptCheck = void (*)();
void set_interrupt_check(InterruptCheck check);

}  // namespace ocisac
