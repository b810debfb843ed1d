// SPDX-License-Identifier: GPL-3.0-or-later
#include "remoteSession.H"
#include "OSspecific.H"
#include "OStringStream.H"
#include "Pstream.H"
#include "clockTime.H"

#include <cmath>

namespace
{

Foam::string textOf(const mm_report* report, const std::string& path)
{
    char text[512];
    mm_report_text(report, path.c_str(), text, sizeof text);
    return Foam::string(text);
}

} // End anonymous namespace


bool Foam::remoteSession::isAway() const
{
    const mm_result error = mm_error(context_);
    return error == MM_UNAVAILABLE || error == MM_DEADLINE_EXCEEDED;
}


void Foam::remoteSession::call
(
    const char* doing,
    const std::function<mm_result()>& made
)
{
    clockTime waiting;
    bool warned = false;
    while (made() != MM_OK)
    {
        if (!isAway() || waiting.elapsedTime() >= patience_)
        {
            fail(doing);
        }
        if (!warned)
        {
            Info<< "remoteMeshMotion: " << mm_error_message(context_) << nl
                << "    waiting " << patience_ << " s for the server at "
                << endpoint_.c_str() << endl;
            warned = true;
        }
        mm_clear_error(context_);
        sleep(1);
    }
}


void Foam::remoteSession::rejoin()
{
    sleep(1);
    if (Pstream::master())
    {
        call("to resume the session", [&]{ return mm_resume(session_); });
    }
    bool resumed = true;
    Pstream::scatter(resumed);
    if (!Pstream::master())
    {
        call("to let a rank join", [&]{ return mm_join(session_); });
    }
}


void Foam::remoteSession::callTogether
(
    const char* doing,
    const std::function<mm_result()>& made
)
{
    computing_ = true;
    if (!Pstream::parRun())
    {
        call(doing, made);
        computing_ = false;
        return;
    }
    clockTime waiting;
    while (true)
    {
        const bool done = made() == MM_OK;
        if (!done && !isAway())
        {
            fail(doing);
        }
        if (returnReduce(done, andOp<bool>()))
        {
            computing_ = false;
            return;
        }
        bool patient = waiting.elapsedTime() < patience_;
        Pstream::scatter(patient);
        if (!patient)
        {
            if (!done)
            {
                fail(doing); // which ends the other ranks too
            }
            continue;
        }
        Info<< "remoteMeshMotion: no answer to all ranks" << nl
            << "    waiting " << patience_ << " s for the server at "
            << endpoint_.c_str() << endl;
        mm_clear_error(context_);
        rejoin();
    }
}


Foam::string Foam::remoteSession::worstCells
(
    const char* path,
    const mm_report* report
) const
{
    OStringStream out;
    const label count = label(mm_report_count(report, path));
    for (label i = 0; i < count && mesh_; ++i)
    {
        const std::string item = std::string(path) + "." + std::to_string(i);
        const int64_t rank = mm_report_integer
        (
            report, (item + ".partition").c_str(), 0
        );
        const int64_t cell = mm_report_integer
        (
            report, (item + ".cell").c_str(), -1
        );
        if (rank == Pstream::myProcNo())
        {
            out << ' ' << mesh_->cellOf(textOf(report, item + ".type"), cell);
        }
        else
        {
            out << " one of processor" << rank;
        }
    }
    return out.str();
}


Foam::string Foam::remoteSession::failure(const char* doing) const
{
    const mm_report* details = mm_error_details(context_);
    const scalar fraction = mm_report_number(details, "fraction");
    const string worst(worstCells("worst", details));
    const string hint
    (
        session_ && isAway() && patience_ <= 0
      ? waitingHint
      : mm_error_hint(context_)
    );
    OStringStream out;
    out << "the mesh-motion server at " << endpoint_.c_str() << " could not "
        << "be asked " << doing << ':' << nl << "    "
        << mm_error_message(context_) << " ("
        << mm_error_code(context_) << ')' << nl;
    if (!worst.empty())
    {
        out << "    worst cells:" << worst.c_str() << nl;
    }
    if (!std::isnan(fraction))
    {
        out << "    " << 100*fraction
            << " % of the displacement would be acceptable" << nl;
    }
    if (!hint.empty())
    {
        out << "    hint: " << hint.c_str() << nl;
    }
    return out.str();
}


void Foam::remoteSession::fail(const char* doing) const
{
    FatalErrorInFunction << failure(doing).c_str() << exit(FatalError);
}


void Foam::remoteSession::report() const
{
    const mm_report* moved = mm_moved(session_);
    const auto number = [&](const char* path)
    {
        return mm_report_number(moved, path);
    };
    Info<< "remoteMeshMotion: step " << step() + 1 << ", iteration "
        << label(mm_iteration(session_)) << ": least quality "
        << number("quality.corrected.metric.min") << " (interpolated alone "
        << number("quality.standard.metric.min") << "), "
        << label(mm_report_integer(moved, "correction.enrichment_points", 0))
        << " enrichment points";
    if (!std::isnan(number("seconds.total")))
    {
        Info<< ", " << number("seconds.total") << " s";
    }
    Info<< endl;
    const label count = label(mm_report_count(moved, "warnings"));
    for (label i = 0; i < count; ++i)
    {
        const std::string path = "warnings." + std::to_string(i);
        Info<< "    " << textOf(moved, path).c_str() << endl;
    }
}
