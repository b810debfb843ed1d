// SPDX-License-Identifier: GPL-3.0-or-later
#include "remoteSession.H"
#include "Pstream.H"
#include "releases.H"

#include <iostream>

const char* const Foam::remoteSession::waitingHint =
    "with the entry 'onServerLoss wait 600;' a run waits for a server that is "
    "started again, and continues";


void Foam::remoteSession::readPatience()
{
    if (!coeffs_.found("onServerLoss"))
    {
        return;
    }
    const tokenList& given = coeffs_.lookup("onServerLoss");
    word choice;
    if (given.size() && given[0].isWord())
    {
        choice = given[0].wordToken();
    }
    if (choice == "wait" && given.size() == 2 && given[1].isNumber())
    {
        patience_ = given[1].number();
    }
    else if (choice != "fail" || given.size() != 1)
    {
        OStringStream words;
        for (const token& t : given)
        {
            words << ' ' << t;
        }
        FatalIOErrorInFunction(coeffs_)
            << "onServerLoss is fail, or wait and the seconds; got"
            << words.str().c_str() << exit(FatalIOError);
    }
}


void Foam::remoteSession::setTimeouts(const scalar atLeast)
{
    const scalar computing =
        coeffs_.lookupOrDefault<scalar>("computeTimeout", 1800);
    mm_set_timeouts
    (
        context_,
        coeffs_.lookupOrDefault<scalar>("timeout", 60),
        max(computing, atLeast)
    );
}


mm_context* Foam::remoteSession::newContext() const
{
    mm_context* context = mm_context_new();
    // one without the other is a mistake, which get() reports
    if (coeffs_.found("secretKey") || coeffs_.found("serverKey"))
    {
        fileName secret(required<fileName>(coeffs_, "secretKey"));
        string server(required<string>(coeffs_, "serverKey"));
        secret.expand();
        server.expand();
        mm_set_keys(context, secret.c_str(), server.c_str());
    }
    return context;
}


void Foam::remoteSession::connect()
{
    setTimeouts(300);
    mm_set_warning(context_, silence, this);
    call("to connect", [&]{ return mm_connect(context_, endpoint_.c_str()); });
}


void Foam::remoteSession::silence(void* session, const char* line)
{
    const remoteSession* own = static_cast<remoteSession*>(session);
    if (!own->computing_)
    {
        std::cerr << "mesh_motion: " << line << std::endl;
        return;
    }
    own->awaitServer(); // for less time than the line says
}


void Foam::remoteSession::awaitServer() const
{
    // a server that computes gets more time than a server that does not answer
    const scalar most =
        max(patience_, coeffs_.lookupOrDefault<scalar>("timeout", 60));
    std::cerr << "remoteMeshMotion: no server answers; waiting " << most
        << " s for the server at " << endpoint_ << std::endl;
    mm_context* other = newContext();
    mm_set_timeouts(other, most, most);
    mm_set_warning(other, nullptr, nullptr);
    const bool there = mm_connect(other, endpoint_.c_str()) == MM_OK;
    const string message(mm_error_message(other));
    mm_context_free(other);
    if (!there)
    {
        FatalErrorInFunction
            << "the mesh-motion server at " << endpoint_.c_str()
            << " could not be asked to go on: " << message.c_str() << nl
            << (patience_ > 0 ? "" : "    hint: ")
            << (patience_ > 0 ? "" : waitingHint) << exit(FatalError);
    }
}


Foam::remoteSession::remoteSession(const dictionary& coeffs)
:
    coeffs_(coeffs),
    endpoint_(string(required<string>(coeffs, "endpoint")).expand()),
    patience_(0),
    context_(newContext()),
    session_(nullptr),
    mesh_(nullptr),
    discards_(coeffs.lookupOrDefault<word>("atEnd", "keep") == "discard"),
    keeps_(coeffs.lookupOrDefault<word>("onRefusal", "fail") == "keep"),
    computing_(false)
{
    readPatience();
    connect();
    session_ = mm_session_new(context_);
    mm_set_partition(session_, Pstream::myProcNo(), Pstream::nProcs());
    setMethod();
}


Foam::remoteSession::~remoteSession()
{
    mm_clear_error(context_);
    mm_close(session_, discards_ ? MM_DISCARD : MM_KEEP);
    mm_session_free(session_);
    mm_context_free(context_);
}


void Foam::remoteSession::setMethodEntry(const entry& e)
{
    const char* key = e.keyword().c_str();
    // a dictionary, or several words, is not a single value
    const token value
    (
        e.isStream() && e.stream().size() == 1 ? e.stream()[0] : token()
    );
    if (value.isLabel())
    {
        mm_set_integer(session_, key, value.labelToken());
    }
    else if (value.isNumber())
    {
        mm_set_number(session_, key, value.number());
    }
    else if (value.isWord() || value.isString())
    {
        const string text
        (
            value.isWord() ? string(value.wordToken()) : value.stringToken()
        );
        if (text == "true" || text == "yes" || text == "on")
        {
            mm_set_flag(session_, key, 1);
        }
        else if (text == "false" || text == "no" || text == "off")
        {
            mm_set_flag(session_, key, 0);
        }
        else
        {
            mm_set_text(session_, key, text.c_str());
        }
    }
    else
    {
        FatalIOErrorInFunction(coeffs_)
            << "method: " << key << " must be a number, a word or a switch"
            << exit(FatalIOError);
    }
}


void Foam::remoteSession::setMethod()
{
    for (const entry& e : coeffs_.subOrEmptyDict("method"))
    {
        setMethodEntry(e);
    }
    const word durability
    (
        coeffs_.lookupOrDefault<word>("durability", word())
    );
    if (!durability.empty())
    {
        mm_set_durability(session_, durability.c_str());
    }
    if (coeffs_.found("evaluation"))
    {
        mm_set_evaluation(session_, required<word>(coeffs_, "evaluation").c_str());
    }
    if (mm_error(context_))
    {
        fail("the settings");
    }
}


void Foam::remoteSession::share()
{
    string id(mm_id(session_));
    List<label> bytes(MM_TOKEN_BYTES, Zero);
    forAll(bytes, i)
    {
        bytes[i] = mm_token(session_)[i];
    }
    Pstream::scatter(id);
    Pstream::scatter(bytes);
    if (!Pstream::master())
    {
        uint8_t token[MM_TOKEN_BYTES];
        forAll(bytes, i)
        {
            token[i] = uint8_t(bytes[i]);
        }
        mm_set_credentials(session_, id.c_str(), token);
        call("to let a rank join", [&]{ return mm_join(session_); });
    }
}


void Foam::remoteSession::describe(const remoteMesh& mesh)
{
    mesh_ = &mesh;
    mm_points
    (
        session_, mesh.dimension(), mesh.size(), mesh.points().data()
    );
    for (const auto& cells : mesh.cells())
    {
        mm_cells
        (
            session_,
            cells.first.c_str(),
            cells.second.cells.size(),
            cells.second.nodes.data()
        );
    }
    for (const remoteMesh::patch& patch : mesh.patches())
    {
        mm_patch
        (
            session_,
            patch.name.c_str(),
            patch.role.c_str(),
            patch.nodes.size(),
            patch.nodes.data()
        );
    }
    if (Pstream::parRun())
    {
        mm_global_ids(session_, mesh.globalIds().data());
    }
}


void Foam::remoteSession::open(const remoteMesh& mesh, const string& name)
{
    mm_set_label(session_, name.c_str());
    describe(mesh);
    if (Pstream::master())
    {
        call("for a session", [&]{ return mm_open(session_); });
    }
    share();
    call("to take the mesh", [&]{ return mm_build(session_); });
    setTimeouts(0);
}


bool Foam::remoteSession::resume
(
    const fileName& path,
    const label step,
    const scalarField* rows,
    const remoteMesh& mesh
)
{
    describe(mesh); // a session that evaluates here needs it
    bool there = false;
    bool behind = false;
    if (Pstream::master())
    {
        if (mm_load_credentials(session_, path.c_str()) == MM_OK)
        {
            call
            (
                "to resume a session",
                [&]
                {
                    const mm_result got = mm_resume(session_);
                    return got == MM_NOT_FOUND ? MM_OK : got;
                }
            );
        }
        behind = rows && mm_step(session_) + 1 == step;
        there =
            mm_error(context_) == MM_OK
         && (behind || mm_step(session_) == step);
        mm_clear_error(context_);
    }
    Pstream::scatter(there);
    Pstream::scatter(behind);
    if (there)
    {
        share();
        there = mm_node_count(session_) == std::size_t(mesh.size());
        reduce(there, andOp<bool>());
    }
    setTimeouts(0);
    if (there && behind)
    {
        scalarField answer;
        there = move(*rows, answer);
        if (there)
        {
            commit(-1);
        }
    }
    return there;
}


mm_result Foam::remoteSession::moveRows(scalarField& answer)
{
    answer.setSize(mesh_->size()*mesh_->dimension());
    return mm_move
    (
        session_,
        MM_SINCE_REFERENCE,
        rows_.size()/mesh_->dimension(),
        rows_.cdata(),
        mesh_->size(),
        answer.data()
    );
}


bool Foam::remoteSession::move(const scalarField& rows, scalarField& answer)
{
    const char* doing = "to move the mesh";
    rows_ = rows;
    refusal_.clear();
    if (!mm_iteration(session_))
    {
        call("whether it is there", [&]{ return mm_ping(context_); });
    }
    callTogether
    (
        doing,
        [&]
        {
            const mm_result got = moveRows(answer);
            const string code(mm_error_code(context_));
            if (!keeps_ || code != "FAILED_PRECONDITION.QUALITY")
            {
                return got;
            }
            refusal_ = failure(doing);
            mm_clear_error(context_);
            return MM_OK;
        }
    );
    if (isRefused())
    {
        WarningInFunction
            << refusal_.c_str() << "    the mesh stays where it was: another "
            << "iteration of this step must be accepted" << endl;
    }
    return !isRefused();
}


void Foam::remoteSession::commit(const label stepsLeft)
{
    if (isRefused())
    {
        FatalErrorInFunction
            << "the step's last iteration was refused" << nl
            << refusal_.c_str() << exit(FatalError);
    }
    const int64_t step = mm_step(session_) + 1;
    mm_set_final_step(session_, stepsLeft < 0 ? 0 : step + stepsLeft);
    callTogether
    (
        "to commit the motion",
        [&]
        {
            if (mm_step(session_) == step)
            {
                return MM_OK; // it was done before, except the answer
            }
            if (!mm_iteration(session_))
            {
                scalarField again; // the trial was lost with the server
                moveRows(again);
            }
            return mm_commit(session_);
        }
    );
}


void Foam::remoteSession::reference(scalarField& points)
{
    points.setSize(mesh_->size()*mesh_->dimension());
    call
    (
        "for the reference mesh",
        [&]
        {
            return mm_fetch
            (
                session_, MM_SINCE_REFERENCE, mesh_->size(), points.data()
            );
        }
    );
}


void Foam::remoteSession::committed(scalarField& points)
{
    points.setSize(mesh_->size()*mesh_->dimension());
    call
    (
        "for the committed mesh",
        [&]
        {
            return mm_fetch
            (
                session_, MM_SINCE_COMMITTED, mesh_->size(), points.data()
            );
        }
    );
}


void Foam::remoteSession::save(const fileName& path)
{
    if (Pstream::master())
    {
        mm_save_credentials(session_, path.c_str());
        if (mm_error(context_))
        {
            fail("to be resumed later");
        }
    }
}


const int64_t* Foam::remoteSession::movingNodes(label& count) const
{
    std::size_t found = 0;
    const int64_t* nodes = mm_moving_nodes(session_, &found);
    count = label(found);
    return nodes;
}
